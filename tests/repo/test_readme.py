"""What the README shows works: its Python block runs, its commands exist, its table is the one of the code."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from tests.repo.checkout import ROOT
from tests.synthetic import base_tables, descriptor, write_dataset

from branchdrive.audit.verdict import EXIT_CODES
from branchdrive.cli.main import run

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_reading_example_runs(tmp_path: Path) -> None:
    write_dataset(tmp_path / "dataset", base_tables(), descriptor())
    block = next(block for block in re.findall(r"```python\n(.*?)```", README, re.S) if "open_dataset" in block)
    names: dict[str, object] = {}
    exec(block.replace("build/demo/dataset", str(tmp_path / "dataset")), names)
    assert [getattr(names[name], "shape", None) for name in ("speed", "past", "future")] == [(16, 1), (80, 3), (10, 4)]


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
