"""A run of a few cases, and the parts of the fuzz: its draws, watch, processes and report."""

from __future__ import annotations

import json
import os
import signal
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.fuzz import __main__ as command
from tests.fuzz.base import write_bases
from tests.fuzz.case import Fuzz
from tests.fuzz.cell import places
from tests.fuzz.damage import TABLE_EDITS
from tests.fuzz.draw import Draw
from tests.fuzz.guard import Guard
from tests.fuzz.pool import Lost, run_cases
from tests.fuzz.report import render, summary
from tests.waiting import PATIENCE_S

from branchdrive.contract.columns import TABLES, table_schema

NUM_CASES = 4


@pytest.fixture(scope="module")
def bases(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return write_bases(tmp_path_factory.mktemp("bases"))


@pytest.fixture(scope="module")
def guard(tmp_path_factory: pytest.TempPathFactory) -> Guard:
    """One hook for all tests here, since an interpreter takes none back."""
    return Guard(tmp_path_factory.mktemp("own"))


def test_draws_depend_on_seed_and_number_alone() -> None:
    first = [Draw(1, 7).below(1000) for _ in range(2)]
    assert first[0] == first[1]
    assert len({Draw(seed, index).below(2**32) for seed in range(3) for index in range(3)}) == 9
    draw = Draw(0, 0)
    assert len({draw.below(2**32) for _ in range(200)}) > 195


def test_cells_of_every_column_of_the_raw_layer_are_edited(bases: dict[str, Path]) -> None:
    expected = {f"raw/{name}.{column.name}" for name, table in TABLES.items() for column in table.columns}
    assert {place.name for base in ("raw", "drives") for place in places(bases[base])} == expected


def test_every_edit_of_a_table_is_one_of_a_table_without_rows_too() -> None:
    empty = table_schema("rollouts").empty_table()
    for edit in TABLE_EDITS.values():
        assert edit(empty)


@pytest.mark.parametrize("touch", [
    lambda root: (root / "new").write_text("x"),
    lambda root: (root / "old").unlink(),
    lambda root: (root / "old").rename(root / "new"),
    lambda root: (root / "folder").mkdir(),
    lambda root: (root / "link").symlink_to("old"),
    lambda root: os.truncate(root / "old", 0),
    lambda root: os.close(os.open(root / "old", os.O_RDWR)),
], ids=["write", "remove", "rename", "mkdir", "link", "truncate", "open"])  # fmt: skip
def test_the_guard_sees_what_touches_the_machine(touch: Callable[[Path], object], guard: Guard, tmp_path: Path) -> None:
    (tmp_path / "old").write_text("x")
    with guard.watching() as found:
        touch(tmp_path)
    assert found
    with guard.watching() as found:
        (tmp_path / "old").exists()
    assert found == []


def test_a_file_changes_when_it_is_opened(guard: Guard, tmp_path: Path) -> None:
    (tmp_path / "a").write_text("before")
    with guard.watching("a", lambda: (tmp_path / "a").write_text("after")) as found:
        assert (tmp_path / "a").read_text() == "after"
    assert found == []


def test_damaged_datasets_end_in_verdicts(
    bases: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "fuzz"
    output.mkdir()
    (output / "bases").symlink_to(next(iter(bases.values())).parent)
    patience = ["--limit-s", str(PATIENCE_S), "--max-cpu-s", str(PATIENCE_S)]
    arguments = ["--output", str(output), "--jobs", "1", "--seed", "1", *patience]
    assert command.main([*arguments, "--cases", str(NUM_CASES // 2)]) == 0
    assert command.main([*arguments, "--cases", str(NUM_CASES)]) == 0  # goes on where it stopped
    figures = json.loads((output / "report.json").read_text())
    assert (figures["tried"], figures["failures"]) == (NUM_CASES, [])
    assert figures["sealed"] >= NUM_CASES / 3
    assert {"invalid", "valid"} <= set(figures["verdicts"]) <= {"invalid", "valid", "partial", "refused"}
    text = (output / "report.txt").read_text()
    assert f"fuzz: {NUM_CASES} of {NUM_CASES} damaged datasets" in text
    assert all(name in text for name in figures["columns"])
    assert "failures (tracebacks, exit code 4, hangs, bounds, writes outside): 0" in capsys.readouterr().out


def test_a_case_is_the_same_again(bases: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", None)  # a process of the fuzz has its own
    first, again = (Fuzz(3, bases, tmp_path / name, max_cpu_s=PATIENCE_S).run(4).to_json() for name in ("one", "two"))
    for row in (first, again):
        del row["cpu_s"], row["memory_bytes"]
    assert first == again


class Endless(dict[str, Path]):
    """Roots of datasets, which a process that takes them up waits for forever."""

    def __reduce__(self) -> tuple[Callable[[], object], tuple[()]]:
        return signal.pause, ()


def test_a_case_that_takes_too_long_or_dies_is_lost_alone(bases: dict[str, Path], tmp_path: Path) -> None:
    missing = dict.fromkeys(bases, tmp_path / "nowhere")
    ((index, lost),) = run_cases([5], 0, missing, tmp_path / "died", jobs=1, limit_s=PATIENCE_S, max_cpu_s=PATIENCE_S)
    assert (index, lost) == (5, Lost("its process died with 1", is_death=True))
    ((index, lost),) = run_cases([5], 0, Endless(), tmp_path / "slow", jobs=1, limit_s=0.01, max_cpu_s=PATIENCE_S)
    assert (index, lost) == (5, Lost("it took more than 0.01 s", is_death=False))


def test_a_process_that_dies_is_tried_again_as_users_run_the_validator(
    bases: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def all_die(indices: Iterable[int], *_: Any, **__: Any) -> Iterator[tuple[int, Lost]]:
        yield from ((index, Lost("its process died with -11", is_death=True)) for index in indices)

    (tmp_path / "bases").symlink_to(next(iter(bases.values())).parent)
    monkeypatch.setattr(command, "run_cases", all_die)
    patience = ["--limit-s", str(PATIENCE_S), "--max-cpu-s", str(PATIENCE_S)]
    assert command.main(["--output", str(tmp_path), "--cases", "1", *patience]) == 0
    (row,) = map(json.loads, (tmp_path / "results-0.jsonl").read_text().splitlines())
    assert (row["index"], row["failure"]) == (0, "")
    assert row["verdict"] in ("valid", "invalid")


def test_the_report_names_failures_and_the_columns_that_are_caught_least() -> None:
    row = {
        "index": 0, "base": "raw", "damage": "cell", "what": "a change", "column": "raw/a.b", "kind": "near",
        "is_sealed": True, "is_changed": True, "verdict": "valid", "rules": [], "cpu_s": 0.5, "memory_bytes": 2**20,
        "failure": "",
    }  # fmt: skip
    rows = [
        row,
        {**row, "index": 1, "column": "raw/a.c", "kind": "null", "verdict": "invalid", "rules": ["BD-NUL-001"]},
        {**row, "index": 2, "column": "raw/a.c", "verdict": "error", "failure": "Traceback\nValueError: bad"},
    ]
    found = summary(rows, planned=9)
    assert list(found["columns"]) == ["raw/a.b", "raw/a.c"]
    assert found["columns"]["raw/a.c"]["caught"] == 1
    text = render(found)
    assert "case 2 (raw, cell: a change): ValueError: bad" in text
    assert "3 of 9 damaged datasets" in text
