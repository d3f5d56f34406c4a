"""Guides show what works: commands and their options exist, tables are those of the code, the collector collects."""

from __future__ import annotations

import io
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from tests.each import each
from tests.repo.checkout import ROOT, name

from branchdrive import open_dataset
from branchdrive.cli.main import run, run_script
from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.validate import validate
from branchdrive.exit_code import EXIT_OF_VERDICT
from branchdrive.raw.funnel import STAGES
from branchdrive_reference.collect.plan import PRESETS

COLLECTOR = "docs/examples/minimal_collector.py"
GUIDES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def text_of(guide: str) -> str:
    return (ROOT / "docs" / guide).read_text(encoding="utf-8")


def commands(page: Path) -> list[list[str]]:
    """Words of every command of the shell examples of a page."""
    blocks = re.findall(r"```(?:sh|bash|console)\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    lines = [line.removeprefix("$ ") for block in blocks for line in block.splitlines() if line.strip()]
    return [shlex.split(line, comments=True) for line in lines]


@each("page", GUIDES, ids=name)
def test_commands_and_their_options_exist(page: Path) -> None:
    for words in commands(page):
        while words and re.fullmatch(r"[A-Z_]+=.*", words[0]):  # the environment of a command
            words = words[1:]
        if not words or not words[0].startswith("branchdrive"):
            continue
        prog, rest = words[0], words[1:]
        if prog == "branchdrive-validate":
            prog, rest = "branchdrive", ["validate", *rest]
        printed = help_of(prog, rest[0])
        assert f"{prog} {rest[0]}" in printed
        known = set(re.findall(r"--[a-z-]+", printed))
        assert {word.partition("=")[0] for word in rest if word.startswith("--")} <= known, words


def help_of(prog: str, command: str) -> str:
    from contextlib import redirect_stdout

    printed = io.StringIO()
    with redirect_stdout(printed), pytest.raises(SystemExit) as stop:
        if prog == "branchdrive-conformance":
            run_script(prog, "branchdrive_conformance.command", [command, "--help"], io.StringIO(), io.StringIO())
        run([command, "--help"], io.StringIO(), io.StringIO())
    assert stop.value.code == 0, command
    return printed.getvalue()


def test_the_guides_show_the_commands_that_people_need() -> None:
    shown = {words[1] for page in GUIDES for words in commands(page) if words and words[0] == "branchdrive"}
    assert shown >= {"build", "collect", "diff", "draw", "init", "inspect", "rules", "study"}


def test_what_is_written_is_ignored_by_git() -> None:
    assert "/build/" in (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()
    for page in (ROOT / "docs" / "tutorial.md", ROOT / "docs" / "reference-world.md", ROOT / "docs" / "validating.md"):
        text = page.read_text(encoding="utf-8")
        outputs = re.findall(r"--output (?:[a-z]+=)?(\S+)", "\n".join(re.findall(r"```sh\n(.*?)```", text, re.S)))
        assert all(path.startswith("build/") for path in outputs), page


def test_the_verdict_table_is_the_codes() -> None:
    table = dict(re.findall(r"^\| `([a-z-]+)` \| ([0-9]) \|", text_of("validating.md"), re.M))
    assert {verdict: int(code) for verdict, code in table.items()} == EXIT_OF_VERDICT


def test_the_table_of_presets_is_the_presets() -> None:
    table = dict(re.findall(r"^\| `--preset ([a-z]+)` \| (.*) \|$", text_of("reference-world.md"), re.M))
    assert table.keys() == PRESETS.keys()
    for preset in ("demo", "paper"):
        assert f"{PRESETS[preset].num_groups:,} " in table[preset]
    assert not PRESETS["demo"].faults and not PRESETS["demo"].replay_noise


def test_every_extra_that_people_install_is_listed() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    listed = {extra for given in re.findall(r"^pip install '\.\[(.*)\]'", text_of("install.md"), re.M)
              for extra in given.split(",")}  # fmt: skip
    assert listed == set(extras) - {"bench", "examples", "test", "dev"}


def test_rules_that_guides_name_exist() -> None:
    for page in GUIDES:
        assert set(re.findall(r"BD-[A-Z]{3}-\d{3}", page.read_text("utf-8"))) <= CATALOGUE.keys(), page


def minimal_collector(root: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, str(ROOT / COLLECTOR), str(root)], capture_output=True, text=True)


def test_the_minimal_collector_writes_a_group_that_qualifies(tmp_path: Path) -> None:
    runs = [minimal_collector(tmp_path / "dataset") for _ in range(2)]
    report = validate(tmp_path / "dataset")
    assert report.verdict == "valid"
    assert report.findings == ()
    assert report.funnel is not None
    assert report.funnel.groups == dict.fromkeys(STAGES, 1)
    assert [run.returncode for run in runs] == [0, 0]
    root = tmp_path / "dataset"
    ends = [f"dataset   {root}", f"identity  {report.dataset.identity}", f"next      branchdrive-validate {root}"]
    collected = [f"{n} collected: {n} with a branch, 0 without, 0 refused; {1 - n} found" for n in (1, 0)]
    for done, groups in zip(runs, collected, strict=True):  # a finished dataset is left as it is
        lines = done.stdout.splitlines()
        assert [*lines[:2], lines[-1]] == ends
        assert lines[-2].startswith("routes    1 route cluster in 1 branched group; a release parts whole clusters")
        assert lines[2] == f"groups    {groups} finished"
    assert (report.dataset.num_groups, report.dataset.num_rollouts) == (1, 15)
    rollouts = open_dataset(root).rollouts().to_pylist()
    assert {row["result_completion"] for row in rollouts} == {"completed"}
    assert {row["result_route_fraction"] for row in rollouts} == {1.0}


def test_the_minimal_collector_refuses_another_folder_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "other.txt").write_text("mine")
    run = minimal_collector(tmp_path)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == f"minimal_collector.py: {tmp_path}: is not empty and holds no dataset; choose another folder\n"


def test_the_writing_excerpt_is_of_the_minimal_collector() -> None:
    page = text_of("collectors.md")
    blocks = [block for block in re.findall(r"```python\n(.*?)```", page, re.S) if "collector_main" in block]
    assert len(blocks) == 1
    assert blocks[0] in (ROOT / COLLECTOR).read_text(encoding="utf-8")
    assert f"python {COLLECTOR} " in page
