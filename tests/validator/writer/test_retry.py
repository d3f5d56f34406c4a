"""Later attempts of groups that are closed, committed or part of a finished dataset."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.validator.writer.invented import make_descriptor, write_dataset, write_group, write_rollout

from branchdrive.contract.layout import MANIFEST_FILE, STAGING_DIR
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive.raw.reader import open_dataset
from branchdrive.writer.writer import DatasetWriter


def open_writer(root: Path) -> DatasetWriter:
    return DatasetWriter(root, make_descriptor(), groups_per_shard=2)


def retry(root: Path, group_id: str) -> str:
    with open_writer(root) as writer:
        with writer.begin_group(group_id) as group:
            write_rollout(group, "intervention", "brake_0.50")
        return writer.finalize()


def test_a_retry_continues_attempt_numbers_and_keeps_what_was_there(tmp_path: Path) -> None:
    write_dataset(tmp_path, 3)
    before = {group_id: open_dataset(tmp_path).group(group_id) for group_id in ("g0", "g1", "g2")}
    retry(tmp_path, "g1")
    after = open_dataset(tmp_path)
    assert [r.rollout_id for r in after.group("g1").interventions["brake_0.50"]] == [
        "g1.brake_0.50.v1.a1",
        "g1.brake_0.50.v1.a2",
    ]
    assert [r for r in after.group("g1").rollouts if r.record["attempt"] == 1] == list(before["g1"].rollouts)
    assert (after.group("g0"), after.group("g2")) == (before["g0"], before["g2"])


def test_a_retry_gives_the_bytes_of_a_collection_in_one_go(tmp_path: Path) -> None:
    write_dataset(tmp_path / "later", 3)
    retry(tmp_path / "later", "g1")
    with open_writer(tmp_path / "at_once") as writer:
        for index in range(3):
            with writer.begin_group(f"g{index}") as group:
                write_group(group)
                if index == 1:
                    write_rollout(group, "intervention", "brake_0.50")
        writer.finalize()
    assert (tmp_path / "later" / MANIFEST_FILE).read_bytes() == (tmp_path / "at_once" / MANIFEST_FILE).read_bytes()


def test_a_retry_rewrites_only_its_own_shard(tmp_path: Path) -> None:
    write_dataset(tmp_path, 3)
    untouched = (tmp_path / "raw/shard-00001/controls.parquet").stat()
    retry(tmp_path, "g1")
    assert (tmp_path / "raw/shard-00001/controls.parquet").stat().st_mtime_ns == untouched.st_mtime_ns


def test_a_retry_without_a_new_attempt_changes_no_byte(tmp_path: Path) -> None:
    write_dataset(tmp_path, 2)
    manifest = (tmp_path / MANIFEST_FILE).read_bytes()
    with open_writer(tmp_path) as writer:
        writer.begin_group("g1").close()
        writer.finalize()
    assert (tmp_path / MANIFEST_FILE).read_bytes() == manifest


def test_the_manifest_is_gone_while_a_group_is_written(tmp_path: Path) -> None:
    write_dataset(tmp_path, 1)
    with open_writer(tmp_path) as writer:
        assert (tmp_path / MANIFEST_FILE).exists()
        group = writer.begin_group("g0")
        assert not (tmp_path / MANIFEST_FILE).exists()
        assert not writer.is_closed("g0")
        group.close()
        assert writer.is_closed("g0")


def test_opening_a_finished_dataset_without_writing_leaves_it_finished(tmp_path: Path) -> None:
    write_dataset(tmp_path, 1)
    manifest = (tmp_path / MANIFEST_FILE).read_bytes()
    with open_writer(tmp_path) as writer:
        assert writer.is_closed("g0")
    assert (tmp_path / MANIFEST_FILE).read_bytes() == manifest
    assert not (tmp_path / STAGING_DIR).exists()


def test_failing_to_open_a_finished_dataset_leaves_it_finished(tmp_path: Path) -> None:
    write_dataset(tmp_path, 1)
    with pytest.raises(UsageError, match="pass 2"):
        DatasetWriter(tmp_path, make_descriptor(), groups_per_shard=3)
    assert sorted(path.name for path in tmp_path.iterdir()) == [MANIFEST_FILE, "branchdrive.json", "raw"]


def test_a_finished_dataset_is_finalized_again_to_the_same_identity(tmp_path: Path) -> None:
    identity = write_dataset(tmp_path, 3)
    with open_writer(tmp_path) as writer:
        assert writer.finalize() == identity


def test_groups_can_be_added_to_a_finished_dataset(tmp_path: Path) -> None:
    write_dataset(tmp_path / "grown", 3)
    with open_writer(tmp_path / "grown") as writer:
        with writer.begin_group("g3") as group:
            assert group.index == 3
            write_group(group)
        writer.finalize()
    write_dataset(tmp_path / "whole", 4)
    assert (tmp_path / "grown" / MANIFEST_FILE).read_bytes() == (tmp_path / "whole" / MANIFEST_FILE).read_bytes()


def test_free_places_stay_free_in_a_finished_dataset(tmp_path: Path) -> None:
    with open_writer(tmp_path) as writer:
        for index in (0, 3):
            with writer.begin_group(f"g{index}", index=index) as group:
                write_group(group)
        writer.finalize()
    with open_writer(tmp_path) as writer:
        with pytest.raises(UsageError, match="taken by group `g3`"):
            writer.begin_group("other", index=3)
        for index in (1, 2):
            with writer.begin_group(f"g{index}", index=index) as group:
                write_group(group)
        writer.finalize()
    write_dataset(tmp_path / "whole", 4)
    assert (tmp_path / MANIFEST_FILE).read_bytes() == (tmp_path / "whole" / MANIFEST_FILE).read_bytes()


def test_shards_of_another_program_are_not_continued(tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    write_dataset(tmp_path, 1)
    path = tmp_path / "raw/shard-00000/rollouts.parquet"
    pq.write_table(pq.read_table(path).replace_schema_metadata(None), path)
    write_manifest(Folder(tmp_path), build_manifest(Folder(tmp_path)))
    with pytest.raises(DatasetError, match="another program"):
        open_writer(tmp_path)
