from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests import synthetic
from tests.validator.writer.invented import ATTEMPTS, write_dataset

from branchdrive.contract.columns import table_schema
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.untrusted_parquet import written_out_bytes
from branchdrive.raw.reader import Dataset, open_dataset


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished dataset of five groups in three shards."""
    root = tmp_path_factory.mktemp("written")
    write_dataset(root, 5)
    return root


@pytest.fixture
def damaged(written: Path, tmp_path: Path) -> Path:
    """A copy of the finished dataset, to be damaged."""
    return Path(shutil.copytree(written, tmp_path / "copy"))


def test_groups_and_rollouts_are_listed(written: Path) -> None:
    dataset = open_dataset(written)
    assert dataset.descriptor.dataset_id == "invented"
    assert dataset.groups == ("g0", "g1", "g2", "g3", "g4")
    rollouts = dataset.rollouts()
    assert rollouts.schema.equals(table_schema("rollouts"), check_metadata=True)
    assert rollouts.num_rows == 5 * len(ATTEMPTS)
    assert repr(dataset) == f"Dataset('invented', 3 shards at {str(written)!r})"


@pytest.mark.parametrize("name", ["rollouts", "controls", "observations", "actors", "evidence"])
def test_tables_are_read_shard_by_shard(written: Path, name: str) -> None:
    table = open_dataset(written).table(name)
    assert len(table) == 3
    assert repr(table) == f"ShardedTable({name!r}, 3 shards)"
    parts = list(table)
    assert all(part.schema.equals(table_schema(name), check_metadata=True) for part in parts)
    assert table.read().equals(pa.concat_tables(parts))
    stored = sorted((written / "raw").glob(f"*/{name}.parquet"))
    assert [part.to_pylist() for part in parts] == [pq.read_table(path).to_pylist() for path in stored]


def test_a_group_is_read_from_rows_in_any_order(damaged: Path) -> None:
    expected = open_dataset(damaged).group("g1")
    for path in damaged.glob("raw/shard-00000/*.parquet"):
        table = pq.read_table(path)
        pq.write_table(table.take(list(reversed(range(table.num_rows)))), path, row_group_size=5)
    assert open_dataset(damaged).group("g1") == expected


def test_groups_of_different_shards_can_be_read_in_turn(written: Path) -> None:
    dataset = open_dataset(written)
    groups = {group_id: dataset.group(group_id) for group_id in ("g0", "g4", "g1", "g0")}
    for group_id, group in groups.items():
        assert {rollout.record["group_id"] for rollout in group.rollouts} == {group_id}
        for rollout in group.rollouts:
            for table in rollout.tables.values():
                assert set(table.column("rollout_id").to_pylist()) <= {rollout.rollout_id}


def test_nothing_is_read_before_it_is_asked_for(damaged: Path) -> None:
    for path in damaged.glob("raw/*/*.parquet"):
        path.write_bytes(b"damaged")
    dataset = open_dataset(damaged)
    for use in (lambda: dataset.groups, dataset.rollouts, lambda: next(iter(dataset.table("controls")))):
        with pytest.raises(DatasetError, match="does not decode"):
            use()


def test_a_dataset_of_another_writer_is_read(tmp_path: Path) -> None:
    synthetic.write_dataset(tmp_path, synthetic.base_tables(), synthetic.descriptor())
    dataset = open_dataset(tmp_path)
    for name in dataset.descriptor.tables:
        expected = pa.concat_tables([tables[name] for tables in synthetic.base_tables().values()])
        assert dataset.table(name).read().equals(expected)
    for group_id in dataset.groups:
        group = dataset.group(group_id)
        assert group.history_observations(group.nominal).shape[0] == 16
        assert sum(r.tables["controls"].num_rows for r in group.rollouts) > 0


def test_media_index_is_a_table_like_others(tmp_path: Path) -> None:
    synthetic.write_dataset(tmp_path, synthetic.media_tables(), synthetic.media_descriptor())
    dataset = open_dataset(tmp_path)
    assert dataset.table("frames").read().num_rows > 0
    assert dataset.group(dataset.groups[0]).nominal.tables["frames"].num_rows == 6 * 26


def test_wrong_names_are_refused_in_words(written: Path) -> None:
    dataset = open_dataset(written)
    with pytest.raises(UsageError, match=r"no table 'frames' in this dataset; there are `rollouts`, "):
        dataset.table("frames")
    tables = dataset.group("g0").nominal.tables
    for name, answer in (("obs", "did you mean 'observations'"), ("zzz", "there are `controls`, `observations`")):
        with pytest.raises(UsageError, match=f"^no table {name!r} in this rollout; {answer}"):
            tables[name]
        assert name not in tables and tables.get(name) is None
    with pytest.raises(UsageError, match="no column 'speed' in 'observations'; did you mean 'speed_mps'"):
        tables.column("observations", "speed")
    with pytest.raises(UsageError, match="no group 'g9' among the 5 groups of this dataset; there are 'g"):
        dataset.group("g9")
    with pytest.raises(
        UsageError, match="no group 'g' among the 5 groups of this dataset; there are 'g0', 'g1', 'g2' and"
    ):
        dataset.group("g")


def _link(path: Path) -> None:
    aside = path.with_name("aside")
    path.rename(aside)
    path.symlink_to(aside)


def _rewrite(path: Path, change: str) -> None:
    table = pq.read_table(path)
    match change:
        case "less":
            table = table.drop_columns(["applied_steer"])
        case "more":
            table = table.append_column("extra", pa.nulls(table.num_rows, pa.int32()))
        case "type":
            table = table.set_column(1, "tick", table.column("tick").cast(pa.int64()))
        case "null":
            table = table.set_column(1, "tick", pa.nulls(table.num_rows, pa.int32()))
    pq.write_table(table, path)


def _second_home(root: Path) -> None:
    shutil.copytree(root / "raw/shard-00000", root / "raw/shard-00009")


DAMAGES: dict[str, tuple[Callable[[Path], object], str]] = {
    "no folder": (lambda root: shutil.rmtree(root), "is not a folder"),
    "no descriptor": (lambda root: (root / "branchdrive.json").unlink(), "'branchdrive.json' does not exist"),
    "descriptor is no JSON": (lambda root: (root / "branchdrive.json").write_text("{"), "is not a descriptor"),
    "descriptor is deep": (lambda root: (root / "branchdrive.json").write_text("[" * 100_000), "nests deeper"),
    "descriptor is wrong": (lambda root: (root / "branchdrive.json").write_text("{}"), "/dataset_id: expected a value"),
    "descriptor is a link": (lambda root: _link(root / "branchdrive.json"), "without following links"),
    "raw is a link": (lambda root: _link(root / "raw"), "without following links"),
    "shard is a link": (lambda root: _link(root / "raw/shard-00001"), "without following links"),
    "table is a link": (lambda root: _link(root / "raw/shard-00001/controls.parquet"), "without following links"),
    "table is missing": (lambda root: (root / "raw/shard-00001/controls.parquet").unlink(), "does not exist"),
    "column is missing": (
        lambda root: _rewrite(root / "raw/shard-00001/controls.parquet", "less"),
        r"columns \['applied_steer'\] are not as",
    ),
    "column too many": (
        lambda root: _rewrite(root / "raw/shard-00001/controls.parquet", "more"),
        r"columns \['extra'\] are not as",
    ),
    "column of another type": (
        lambda root: _rewrite(root / "raw/shard-00001/controls.parquet", "type"),
        r"columns \['tick'\] are not as",
    ),
    "null in a required column": (
        lambda root: _rewrite(root / "raw/shard-00001/controls.parquet", "null"),
        r"columns \['tick'\] hold nulls",
    ),
    "group in two shards": (_second_home, r"lies in two shards, \['shard-00000', 'shard-00009'\]"),
}


def read_all(root: Path) -> None:
    dataset: Dataset = open_dataset(root)
    for group_id in dataset.groups:
        dataset.group(group_id)


@pytest.mark.parametrize("damage", DAMAGES)
def test_what_cannot_be_read_safely_is_refused_in_words(damaged: Path, damage: str) -> None:
    act, message = DAMAGES[damage]
    act(damaged)
    with pytest.raises(DatasetError, match=message):
        read_all(damaged)


def test_text_that_would_not_fit_in_memory_is_refused_before_it_is_written_out(
    written: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shard = open_dataset(written).shards[0]
    stored, plain = shard.decode("rollouts"), shard.table("rollouts")
    texts = [field.name for field in plain.schema if str(field.type) == "string"]
    num_bytes = sum(len(text or "") for name in texts for text in plain.column(name).to_pylist())
    assert written_out_bytes(stored) == num_bytes
    for limit, is_refused in ((num_bytes, False), (num_bytes - 1, True)):
        limits = dataclasses.replace(spec_limits(), max_table_decoded_bytes=limit)
        monkeypatch.setattr("branchdrive.formats.table_file.spec_limits", lambda limits=limits: limits)
        if is_refused:
            with pytest.raises(DatasetError, match=f"its text is {num_bytes:,} bytes long"):
                shard.decode("rollouts")
        else:
            assert shard.decode("rollouts").num_rows == stored.num_rows
