"""The page on closed loops shows commands that exist and explains every option."""

from __future__ import annotations

import argparse
import re
import shlex

from tests.repo.checkout import ROOT

from branchdrive_reference.closed_loop import command
from branchdrive_reference.closed_loop.external import PATIENCE_S

PAGE = (ROOT / "docs" / "driving.md").read_text(encoding="utf-8")
LINES = [
    shlex.split(line.removeprefix("PYTHONPATH=. "))
    for block in re.findall(r"```sh\n(.*?)```", PAGE, re.S)
    for line in block.splitlines()
    if line
]


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser()
    command.add_arguments(made)
    return made


def test_commands_parse() -> None:
    assert LINES
    for words in LINES:
        assert words[:2] == ["branchdrive", "drive"]
        parser().parse_args(words[2:])


def test_every_option_is_explained() -> None:
    options = {option for action in parser()._actions for option in action.option_strings} - {"-h", "--help"}
    assert set(re.findall(r"^\| `(--[a-z-]+)", PAGE, re.M)) == options


def test_bounds_are_those_of_the_code() -> None:
    assert f"more than {PATIENCE_S:.0f} s" in PAGE
