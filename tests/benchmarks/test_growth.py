"""Growth is measured on shards that are audited once and repeated: groups of their own, which rules accept."""

from __future__ import annotations

from pathlib import Path

import pytest
from benchmarks.growth import ALL_STAGES, StageCost, _row, measure, rows
from benchmarks.repeated import AuditedShard, Repeating, audited_shard, repeated_dataset
from tests.reference_impl.collect.kept_collection import kept_collection

from branchdrive.contract.layer import part_of, table_paths
from branchdrive.engine.validate import validate
from branchdrive.files.survey import take_survey
from branchdrive.formats.folder import Folder
from branchdrive.formats.table_file import read_layer_table
from branchdrive.release.builder import build_release
from branchdrive.runtime.executor import in_process

NUM_GROUPS = 6
STAGES = ("canonical", "quality", "model")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return kept_collection(tmp_path_factory.mktemp("source") / "source", num_groups=NUM_GROUPS, seed=1)


@pytest.fixture(scope="module")
def shard(source: Path) -> AuditedShard:
    return audited_shard(source, in_process)


def test_a_repeated_shard_is_one_of_other_groups(shard: AuditedShard, tmp_path: Path) -> None:
    root, executor = tmp_path / "dataset", Repeating(shard, in_process)
    size = repeated_dataset(shard, root, 65 * shard.num_groups)
    assert size == 65 * shard.num_groups
    report = validate(root, executor=executor)
    assert (report.verdict, report.dataset.num_groups) == ("valid", size)
    build_release(root, stages=STAGES, executor=executor)
    records = read_layer_table(Folder(root), "records")
    assert len(set(records["group_id"].to_pylist())) == size
    assert {part_of(folder) for folder in records["shard"].to_pylist() if folder} == {0, 1}
    assert len(table_paths("records", take_survey(Folder(root)).release_files)) == 2


@pytest.mark.parametrize("stage", ["validate", "build"])
def test_a_stage_is_measured(stage: str, shard: AuditedShard, tmp_path: Path) -> None:
    cost = measure(stage, shard, tmp_path, 4 * shard.num_groups, 1)
    assert cost.num_groups == 4 * shard.num_groups
    assert cost.cpu_s > 0


def test_exponent_and_memory_are_those_of_the_first_and_the_last_size() -> None:
    row = _row("it", [StageCost(1_000, 2.0, 10_000_000), StageCost(10_000, 200.0, 100_000_000)], 2)
    assert row.measured == "2.0, 20.0 ms, exponent 2.00\n10.0 kB"
    assert row.what.startswith("growth of it, 1,000, 10,000 groups, 2 worker(s)")


@pytest.mark.thorough
def test_every_stage_has_a_row(source: Path, tmp_path: Path) -> None:
    (tmp_path / "source").symlink_to(source)
    found = [*rows(tmp_path, sizes=(12, 24), stages=ALL_STAGES, jobs=1)]
    assert len(found) == 4
    assert [row.bar for row in found] == ["<= 1.1\n<= 10 kB"] * 3 + [""]
    assert found[-1].measured.startswith("274,")
