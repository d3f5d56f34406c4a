"""The README is one screen and a bit: what, why, two commands, three pictures, and where to go on."""

from __future__ import annotations

import io
import re
import shlex
from importlib import import_module
from importlib.metadata import entry_points

import pytest
from tests.repo.checkout import ROOT

from branchdrive.cli.main import run

README = (ROOT / "README.md").read_text(encoding="utf-8")
MAX_LINES = 65
MAX_PICTURE_BYTES = 150_000


def test_it_is_short() -> None:
    assert README.count("\n") <= MAX_LINES


def test_its_commands_are_verbs_of_make_and_do_what_is_said() -> None:
    (block,) = re.findall(r"```sh\n(.*?)```", README, re.S)
    commands = [shlex.split(line, comments=True) for line in block.splitlines()]
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    verbs = set(re.findall(r"^([a-z-]+):", makefile, re.M))
    assert commands == [["make", "demo"], ["make", "test"]]
    assert set(re.findall(r"`make ([a-z-]+)`", README)) | {"demo", "test"} <= verbs
    assert "DEMO := build/demo\n" in makefile
    assert "--output $(DEMO)/report.html" in makefile and "`build/demo/report.html`" in README


def test_its_pictures_are_there_and_small() -> None:
    pictures = re.findall(r"!\[([^\]]+)\]\(([^)]+)\)", README)
    assert len(pictures) >= 3
    for words, path in pictures:
        assert len(words) > 20, f"{path}: say what it shows"
        assert (ROOT / path).stat().st_size <= MAX_PICTURE_BYTES, path


def test_the_first_picture_is_what_the_text_says() -> None:
    before, _, _ = README.partition("## Try it")
    assert re.search(r"twelve executed interventions", before) and "docs/pictures/branch-group.png" in before


def test_it_leads_to_the_guide_of_every_task() -> None:
    table = README.partition("## Where to go on")[2].partition("\n## ")[0]
    tasks = ("install", "collectors", "validating", "releases", "publishing", "benchmark", "validators")
    assert {f"docs/{task}.md" for task in tasks} <= set(re.findall(r"\]\(([^)#]+)", table))


def test_the_help_tells_what_every_command_does(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        run(["--help"], io.StringIO(), io.StringIO())
    printed = " ".join(capsys.readouterr().out.split())
    for command in entry_points(group="branchdrive.commands"):
        assert f"{command.name} {import_module(command.value).SUMMARY}" in printed
