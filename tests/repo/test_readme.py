"""What the README shows works: its examples run, its commands exist, its table is the one of the code."""

from __future__ import annotations

import re
import subprocess
import sys
from typing import TYPE_CHECKING

from tests.repo.checkout import ROOT
from tests.synthetic import base_tables, descriptor, write_dataset

from branchdrive.audit.engine import validate
from branchdrive.audit.funnel import STAGES
from branchdrive.audit.verdict import EXIT_CODES
from branchdrive.cli.main import run

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

COLLECTOR = "docs/examples/minimal_collector.py"
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_reading_example_runs(tmp_path: Path) -> None:
    write_dataset(tmp_path / "dataset", base_tables(), descriptor())
    block = next(block for block in re.findall(r"```python\n(.*?)```", README, re.S) if "open_dataset" in block)
    names: dict[str, object] = {}
    exec(block.replace("build/demo/dataset", str(tmp_path / "dataset")), names)
    assert [getattr(names[name], "shape", None) for name in ("speed", "past", "future")] == [(16, 1), (80, 3), (10, 4)]


def test_the_minimal_collector_writes_a_group_that_qualifies(tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / COLLECTOR), str(tmp_path / "dataset")]
    printed = [subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip() for _ in range(2)]
    report = validate(tmp_path / "dataset")
    assert report.verdict == "valid"
    assert report.funnel is not None
    assert report.funnel.groups == dict.fromkeys(STAGES, 1)
    assert printed == [report.dataset.identity] * 2  # a finished dataset is left as it is
    assert (report.dataset.num_groups, report.dataset.num_rollouts) == (1, 14)


def test_the_writing_excerpt_is_of_the_minimal_collector() -> None:
    blocks = [block for block in re.findall(r"```python\n(.*?)```", README, re.S) if "DatasetWriter" in block]
    assert len(blocks) == 1
    assert blocks[0] in (ROOT / COLLECTOR).read_text(encoding="utf-8")
    assert f".venv/bin/python {COLLECTOR} my-dataset\n" in README


def test_the_commands_exist(capsys: pytest.CaptureFixture[str]) -> None:
    import io

    for command in set(re.findall(r"bin/branchdrive ([a-z]+)", README)):
        try:
            run([command, "--help"], io.StringIO(), io.StringIO())
        except SystemExit as stop:
            assert stop.code == 0, command
        assert f"branchdrive {command}" in capsys.readouterr().out


def test_the_verdict_table_is_the_codes() -> None:
    table = dict(re.findall(r"^\| `([a-z-]+)` \| ([0-9]) \|", README, re.M))
    assert {verdict: int(code) for verdict, code in table.items()} == EXIT_CODES


def test_make_verbs_of_the_readme_exist() -> None:
    verbs = set(re.findall(r"^make ([a-z]+)", README, re.M))
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    assert verbs and verbs <= targets


def test_the_help_tells_what_every_command_does(capsys: pytest.CaptureFixture[str]) -> None:
    import io
    from importlib import import_module
    from importlib.metadata import entry_points

    try:
        run(["--help"], io.StringIO(), io.StringIO())
    except SystemExit:
        printed = " ".join(capsys.readouterr().out.split())
    for command in entry_points(group="branchdrive.commands"):
        assert f"{command.name} {import_module(command.value).SUMMARY}" in printed
