"""The page on the benchmark shows commands that exist, explains every option, and names files and bounds."""

from __future__ import annotations

import argparse
import inspect
import json
import re
import shlex
from pathlib import Path
from types import ModuleType

from tests.each import each
from tests.repo.checkout import ROOT

from branchdrive.benchmark.protocol.protocol import (
    MAX_MEMBERS,
    MAX_OWNERS,
    default_protocol,
    read_protocol,
    visual_protocol,
)
from branchdrive.benchmark.warning import warnings
from branchdrive.cli import build, validate
from branchdrive.contract.rule import CATALOGUE
from branchdrive.driving.target import TARGETS, TRAJECTORY
from branchdrive.quality.ledger import PREDICTION_ACCESS, with_benchmark_access
from branchdrive.statistics.bca import LEAST_UNITS
from branchdrive_reference.benchmark.command import benchmark, curve, evaluate, export, latency, lock, predict, train
from branchdrive_reference.benchmark.document import read_protocol_file, trees_protocol
from branchdrive_reference.benchmark.figure import gallery
from branchdrive_reference.collect import command as collect
from branchdrive_reference.learning.configuration import Configuration

PAGE = (ROOT / "docs" / "benchmark.md").read_text(encoding="utf-8")
LINES = [
    shlex.split(line) for block in re.findall(r"```sh\n(.*?)```", PAGE, re.S) for line in block.splitlines() if line
]
COMMANDS: dict[str, ModuleType] = {
    "train": train, "lock": lock, "predict": predict, "evaluate": evaluate, "export": export, "latency": latency,
    "curve": curve, "benchmark": benchmark,
}  # fmt: skip
OTHERS: dict[str, ModuleType] = {"collect": collect, "build": build, "branchdrive-validate": validate}


def parser_of(command: ModuleType) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    return parser


def options_of(command: ModuleType) -> set[str]:
    found = {option for action in parser_of(command)._actions for option in action.option_strings}
    return found - {"-h", "--help"}


@each("words", LINES, ids=" ".join)
def test_commands_parse(words: list[str]) -> None:
    name, *arguments = words[1:] if words[0] == "branchdrive" else words
    parser_of((COMMANDS | OTHERS)[name]).parse_args(arguments)


def test_every_command_is_shown_and_has_its_line() -> None:
    assert {words[1] for words in LINES if words[0] == "branchdrive"} >= set(COMMANDS)
    assert re.findall(r"^\| `branchdrive ([a-z]+)` \|", PAGE, re.M) == list(COMMANDS)


def test_every_option_is_explained_for_its_commands() -> None:
    rows = re.findall(r"^\| `(--[a-z-]+)[^`]*` \| (.*?) \|", PAGE, re.M)
    stated = {option: set(re.findall(r"`([a-z]+)`", commands)) for option, commands in rows}
    assert len(stated) == len(rows)
    wanted: dict[str, set[str]] = {}
    for name, command in COMMANDS.items():
        for option in options_of(command):
            wanted.setdefault(option, set()).add(name)
    assert stated == wanted


def test_the_columns_of_predictions_are_those_that_are_read() -> None:
    table = PAGE.split("## Predictions of others")[1].split("Every value is there")[0]
    columns = [
        name for row in re.findall(r"^\| (`.*?`) \|", table, re.M) for name in re.findall(r"`([a-z_0-9]+)`", row)
    ]
    assert columns == ["group_id", "action_key", "seed", *(target.name for target in TARGETS), *TRAJECTORY]


def test_models_seeds_and_bounds_are_those_of_the_protocol() -> None:
    models = visual_protocol().models
    assert re.findall(r"^\| (M[0-9]r?) \| .* \| .* \|$", PAGE.split("### Guards")[0], re.M) == [
        model.id for model in models
    ]
    for model in models[1:]:
        assert f"| {', '.join(map(str, model.seeds))} |" in PAGE
    assert f"more than {MAX_MEMBERS} tests in all families, and more than {MAX_OWNERS} seeds" in PAGE
    assert f"With fewer than {LEAST_UNITS} route clusters in `test`" in PAGE
    guard = default_protocol().guard
    assert f"fewer than {guard.min_groups} groups or {guard.min_clusters} route clusters" in PAGE
    assert (
        f"more than {guard.tolerance_m} m below that of nominal; the rate it promises is at most {guard.alpha}" in PAGE
    )


def test_baselines_are_those_of_the_protocol() -> None:
    table = PAGE.split("### Baselines")[1].split("### ")[0]
    named = re.findall(r"`([a-z_]+)`", " ".join(re.findall(r"^\| (`.*?`) \|", table, re.M)))
    declared = {baseline.name: baseline for baseline in default_protocol().baselines}
    assert named == ["action_prior", *declared]
    assert f"as if by {declared['type_prior'].strength:g} groups of them" in table
    assert f"the {declared['neighbours'].neighbours} groups of `train` with the nearest histories" in table


def test_trees_are_declared_as_the_page_says() -> None:
    found, normative = trees_protocol(), default_protocol()
    assert [*found.models[:-2]] == [*normative.models]
    sensor, privileged = found.models[-2:]
    assert (sensor.id, sensor.contract, privileged.id, privileged.contract) == ("T3", "sensor", "T3p", "privileged")
    assert (sensor.reported_apart, privileged.reported_apart) == (None, True)
    assert "on the sensor history (`T3`) and, as another bound that is reported apart, on the privileged" in PAGE
    others = {"name": found.name, "models": found.document["models"]}
    assert found.document == {**normative.document, **others}
    assert found.name != normative.name
    assert read_protocol_file(Path("trees")) == found
    for model in found.models:
        Configuration.of(model)


@each("normative", ["default_protocol", "visual_protocol"])
def test_the_trial_is_a_protocol_of_one_seed_and_few_epochs(normative: str, tmp_path: Path) -> None:
    (block,) = (found for found in re.findall(r"```python\n(.*?)```", PAGE, re.S) if "max_epochs" in found)
    written = tmp_path / "trial.json"
    exec(block.replace("build/trial.json", str(written)).replace("default_protocol", normative), {})
    found = read_protocol(json.loads(written.read_text()))
    configurations = [Configuration.of(model) for model in found.models]
    assert {len(model.seeds) for model in found.models} == {1}
    assert {configuration.training.max_epochs for configuration in configurations} == {2}


def test_the_sentence_on_accesses_is_the_one_that_tables_carry() -> None:
    twice = with_benchmark_access(with_benchmark_access(None, PREDICTION_ACCESS, "a" * 64), PREDICTION_ACCESS, "b" * 64)
    (block,) = re.findall(r"```text\n(.*?)```", PAGE, re.S)
    assert warnings(twice) == [" ".join(block.split())]


def test_the_figures_are_named() -> None:
    stated = re.search(r"The figures are (.*?), each as PNG and SVG", PAGE)
    assert stated is not None
    assert set(re.findall(r"`([a-z_]+)`", stated[1])) == set(
        re.findall(r'draws\["([a-z_]+)"\]', inspect.getsource(gallery))
    )


def test_the_rules_need_no_raw_layer() -> None:
    rules = [info for info in CATALOGUE.values() if info.id.startswith("BD-BMK")]
    assert rules and not any(info.needs_raw for info in rules)
    assert "The rules BD-BMK need no raw layer." in PAGE
