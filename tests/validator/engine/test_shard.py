"""Reading a shard: only the shard's own tables are judged, whatever their bytes look like."""

from __future__ import annotations

import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.synthetic import base_tables, descriptor, seal_dataset, write_dataset

from branchdrive import open_dataset, validate

FOLDER = "raw/shard-00000"


def failed(root: Path) -> set[str]:
    report = validate(root)
    assert report.verdict != "error"
    return {tally.rule_id for tally in report.tallies if tally.status == "fail"}


def test_a_nested_table_never_stands_in_for_the_real_one(tmp_path: Path) -> None:
    root = tmp_path / "dataset"
    tables = {folder: dict(shard) for folder, shard in base_tables().items()}
    controls = tables[FOLDER]["controls"]
    index = controls.schema.get_field_index("applied_brake")
    spoiled = pa.array([7.0] * len(controls), pa.float32())
    tables[FOLDER]["controls"] = controls.set_column(index, controls.schema.field(index), spoiled)
    write_dataset(root, tables, descriptor())
    write_dataset(tmp_path / "clean", base_tables(), descriptor())
    (root / FOLDER / "zz").mkdir()
    shutil.copy(tmp_path / "clean" / FOLDER / "controls.parquet", root / FOLDER / "zz")
    seal_dataset(root)
    assert {"BD-VAL-002", "BD-LAY-009"} <= failed(root)


@pytest.mark.parametrize("index_type", [pa.int8(), pa.uint8(), pa.int16(), pa.int64()], ids=str)
def test_any_dictionary_index_reads_as_text(tmp_path: Path, index_type: pa.DataType) -> None:
    root = tmp_path / "dataset"
    write_dataset(root, base_tables(), descriptor())
    path = root / FOLDER / "controls.parquet"
    table = pq.read_table(path)
    field = table.schema.field("source")
    text = table["source"].cast(pa.dictionary(index_type, pa.string()))
    table = table.set_column(table.schema.get_field_index("source"), field.with_type(text.type), text)
    pq.write_table(table, path)
    seal_dataset(root)
    assert failed(root) == set()


WRITES_NO_VIEWS = pytest.mark.skipif(pa.__version__.startswith("18."), reason="pyarrow 18 writes no string views")


@pytest.mark.parametrize("kind", [pa.large_string(), pytest.param(pa.string_view(), marks=WRITES_NO_VIEWS)], ids=str)
def test_text_and_lists_of_other_writers_read_alike(tmp_path: Path, kind: pa.DataType) -> None:
    root = tmp_path / "dataset"
    write_dataset(root, base_tables(), descriptor())
    path = root / FOLDER / "rollouts.parquet"
    table = pq.read_table(path)
    lists = pa.large_list(pa.field("item", pa.float64(), nullable=False))
    types = {pa.string(): kind, pa.list_(pa.float64()): lists}
    table = table.cast(pa.schema([field.with_type(types.get(field.type, field.type)) for field in table.schema]))
    pq.write_table(table, path)
    seal_dataset(root)
    assert failed(root) == set()
    assert open_dataset(root).groups


def test_a_shard_of_too_many_rollouts_is_over_a_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from dataclasses import replace

    from branchdrive.contract.limits import spec_limits
    from branchdrive.engine import shard

    root = tmp_path / "dataset"
    write_dataset(root, base_tables(), descriptor())
    most = max(len(tables["rollouts"]) for tables in base_tables().values())
    monkeypatch.setattr(shard, "spec_limits", lambda: replace(spec_limits(), max_shard_rollouts=most))
    assert failed(root) == set()
    monkeypatch.setattr(shard, "spec_limits", lambda: replace(spec_limits(), max_shard_rollouts=most - 1))
    assert failed(root) == {"BD-LAY-007"}
