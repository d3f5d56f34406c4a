"""The page on releases shows commands that exist, explains every option, and counts the rules as they are."""

from __future__ import annotations

import argparse
import json
import re
import shlex

from tests.repo.checkout import ROOT

from branchdrive.cli import build, validate
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.rule import CATALOGUE
from branchdrive.quality.variants import declared_variants
from branchdrive.release.builder import STAGES

PAGE = (ROOT / "docs" / "releases.md").read_text(encoding="utf-8")
COMMANDS = [
    shlex.split(line) for block in re.findall(r"```sh\n(.*?)```", PAGE, re.S) for line in block.splitlines() if line
]


def parser_of(command: object) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)  # type: ignore[attr-defined]
    return parser


def test_commands_parse() -> None:
    builds = [words[2:] for words in COMMANDS if words[:2] == ["branchdrive", "build"]]
    validations = [words[1:] for words in COMMANDS if words[0] == "branchdrive-validate"]
    for words in builds:
        parser_of(build).parse_args(words)
    for words in validations:
        parser_of(validate).parse_args(words)
    assert (len(builds), len(validations)) == (6, 3)


def test_every_option_of_the_builder_is_explained() -> None:
    table = re.findall(r"^\| `(--[a-z-]+)[^`]*` \|", PAGE, re.M)
    actions = parser_of(build)._actions
    assert sorted(table) == sorted(
        option for action in actions for option in action.option_strings if option not in ("-h", "--help")
    )


def test_every_layer_and_stage_has_its_line() -> None:
    rows = re.findall(r"^\| `([a-z]+)` \| .* \| (.*) \|$", PAGE.split("## Build one")[0], re.M)
    assert [name for name, _ in rows] == ["raw", *LAYERS]
    assert [stage for _, made in rows for stage in re.findall(r"`([a-z]+)`", made)] == list(STAGES)


def test_rules_are_counted() -> None:
    rules = [info for info in CATALOGUE.values() if info.layer is not None]
    needing = sum(info.needs_raw for info in rules)
    assert f"Of the {len(rules)} rules on derived layers {needing} need raw rows" in PAGE
    areas = set(re.findall(r"\| (BD-[A-Z]{3}) \|", PAGE))
    assert areas == {info.id[:6] for info in rules}


def test_the_variants_can_be_declared() -> None:
    (block,) = re.findall(r"```json\n(.*?)```", PAGE, re.S)
    assert [variant.name for variant in declared_variants(json.loads(block))] == ["eligible", "screened"]
