"""A null in any column of any file of any table is a finding where it is not allowed, and never stops the validator.

Here every file is read, and derived tables are judged by their form; `test_changed_documents` judges what reads them.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.fuzz.base import write_base
from tests.fuzz.cell import Place, places
from tests.sampling import THOROUGH
from tests.validator.engine.rules.benchmark_release import BenchmarkDraft

from branchdrive.contract.layer import table_file
from branchdrive.engine.derived_files import layer_files_tasks, read_layers
from branchdrive.engine.spool import Spool
from branchdrive.engine.validate import validate
from branchdrive.files.survey import take_survey
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.untrusted_parquet import decode_table
from branchdrive.testing.defect import with_cells

SHARES = [24, pytest.param(1, marks=THOROUGH)]
"""One of so many columns is tried."""


def with_a_null(root: Path, some: list[Place]) -> Iterator[Place]:
    """Columns of files below `root`, each while its first value is null."""
    for place in some:
        path = root / place.path
        content = path.read_bytes()
        table = decode_table(content, place.table)
        row = next((row for row, value in enumerate(table[place.column.name].to_pylist()) if value is not None), None)
        if row is not None:
            path.write_bytes(encode_table(with_cells(table, place.column.name, {row: None})))
            yield place
            path.write_bytes(content)


@pytest.mark.parametrize("share", SHARES)
def test_a_null_in_a_raw_table_is_a_finding(share: int, tmp_path: Path) -> None:
    write_base("raw", root := tmp_path / "dataset")
    wrong = []
    for place in with_a_null(root, places(root)[::share]):
        write_manifest(Folder(root), build_manifest(Folder(root)))
        report = validate(root, media="index")
        name = place.column.name  # of one that decides whether others are there, these say so
        is_named = any(f.location.get("column") == name or f"`{name}` is null" in f.expected for f in report.findings)
        is_allowed = place.column.available is not None and place.column.available.when == "optional"
        if report.errors or not (is_named or is_allowed):
            wrong.append((place.path, name, report.verdict, report.errors))
    assert wrong == []


@pytest.mark.parametrize("share", SHARES)
def test_a_null_in_a_file_of_a_layer_is_a_finding(share: int, tmp_path: Path) -> None:
    root = BenchmarkDraft().write(tmp_path / "dataset")
    survey = take_survey(Folder(root), hash_files=False)
    derived = [place for place in places(root) if table_file(place.path) is not None]
    wrong = []
    for place in with_a_null(root, derived[::share]):
        with Spool.temporary() as spool:
            (task,) = (task for task in layer_files_tasks(survey, spool) if place.path in task.files)
            nulls = read_layers(task).tallies["BD-LYR-008"]
        where = {"file": place.path, "column": place.column.name}
        if not any(where.items() <= finding.location.items() for finding in nulls.findings):
            wrong.append((place.path, place.column.name, nulls))
    assert wrong == []
