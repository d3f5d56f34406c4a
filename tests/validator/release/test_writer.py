"""A build in place and a collection keep apart: there is one writer at a time, and what is unfinished stays so."""

from __future__ import annotations

import stat
from pathlib import Path
from typing import Any

import pytest
from tests.synthetic import descriptor as media_free_descriptor
from tests.synthetic import write_dataset
from tests.synthetic_release import raw_tables
from tests.validator.release.running import build, contents
from tests.validator.writer.invented import write_dataset as write_small

from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE, STAGING_DIR
from branchdrive.engine.spool import Spool
from branchdrive.engine.validate import validate
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.descriptor_file import read_descriptor, render_descriptor
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive.release import builder as builder
from branchdrive.release.publish import RENDER_DIR, lock_area, staging
from branchdrive.release.scan import RawScan, scan_raw
from branchdrive.runtime.executor import in_process
from branchdrive.writer.group_writer import GroupWriter
from branchdrive.writer.writer import DatasetWriter

AT_WORK = "a collection, a build or a benchmark is running there; wait until it has finished"


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """A dataset that a `DatasetWriter` can open: without media, and with a descriptor as it writes it."""
    root = tmp_path / "dataset"
    tables = {
        folder: {name: table for name, table in shard.items() if name != "frames"}
        for folder, shard in raw_tables().items()
    }
    write_dataset(root, tables, media_free_descriptor())
    (root / DESCRIPTOR_FILE).write_bytes(render_descriptor(read_descriptor(Folder(root))))
    write_manifest(Folder(root), build_manifest(Folder(root)))
    return root


@pytest.fixture
def collected(tmp_path: Path) -> Path:
    """A finished dataset of a `DatasetWriter`."""
    write_small(tmp_path / "collected", 3)
    return tmp_path / "collected"


def test_a_build_is_refused_while_a_collection_is_open(collected: Path) -> None:
    dataset, descriptor = collected, read_descriptor(Folder(collected))
    with DatasetWriter(dataset, descriptor, groups_per_shard=2) as writer:
        held = contents(dataset)
        with pytest.raises(UsageError, match=AT_WORK):
            build(dataset)
        assert contents(dataset) == held
        writer.begin_group("new")
        begun = contents(dataset)
        assert MANIFEST_FILE not in begun
        with pytest.raises(UsageError, match=AT_WORK):
            build(dataset)
        assert contents(dataset) == begun


def test_a_collection_that_stopped_stays_unfinished(collected: Path) -> None:
    dataset, descriptor = collected, read_descriptor(Folder(collected))
    with DatasetWriter(dataset, descriptor, groups_per_shard=2) as writer:
        writer.begin_group("new")
    begun = contents(dataset)
    assert MANIFEST_FILE not in begun
    with pytest.raises(
        UsageError, match=r"an unfinished collection has '.*' in \.staging; finish the collection before"
    ):
        build(dataset)
    assert contents(dataset) == begun


def test_no_collection_begins_while_a_build_is_at_work(dataset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[str] = []

    def begin() -> None:
        with pytest.raises(UsageError, match="another `DatasetWriter` has the dataset open"):
            DatasetWriter(dataset, read_descriptor(Folder(dataset))).begin_group("new")
        with pytest.raises(UsageError, match="open the dataset with `DatasetWriter` before writing groups"):
            GroupWriter(dataset, read_descriptor(Folder(dataset)), "new", 99)

    def scan(*arguments: Any, **options: Any) -> RawScan:
        begin()
        found = scan_raw(*arguments, **options)
        begin()
        return found

    def at_stage(stage: str, done: int, *_: Any) -> None:
        if stage in ("quality", "model"):
            tried.append(stage)
            begin()

    monkeypatch.setattr(builder, "scan_raw", scan)
    build(dataset, progress=at_stage)
    assert tried
    assert validate(dataset).verdict == "valid"
    assert not (dataset / STAGING_DIR).exists()


@pytest.mark.parametrize("change", ["gone", "other"])
def test_nothing_is_published_over_a_raw_layer_that_changed_meanwhile(dataset: Path, change: str) -> None:
    def spoil(stage: str, done: int, *_: Any) -> None:
        if (stage, done) == ("canonical", 0):
            if change == "gone":
                (dataset / MANIFEST_FILE).unlink()
            else:
                path = dataset / "raw/shard-00000/controls.parquet"
                path.write_bytes((dataset / "raw/shard-00001/controls.parquet").read_bytes())
                write_manifest(Folder(dataset), build_manifest(Folder(dataset)))

    descriptor_bytes = (dataset / DESCRIPTOR_FILE).read_bytes()
    with pytest.raises(DatasetError, match="its raw layer was changed while it was built from"):
        build(dataset, progress=spoil)
    assert (dataset / MANIFEST_FILE).exists() == (change == "other")
    assert (dataset / DESCRIPTOR_FILE).read_bytes() == descriptor_bytes
    assert not (dataset / "canonical").exists()
    assert not (dataset / STAGING_DIR).exists()


def test_a_writer_may_begin_when_a_build_is_done(dataset: Path) -> None:
    with staging(dataset) as area:
        assert area == dataset / STAGING_DIR / "build"
        assert stat.S_IMODE(area.stat().st_mode) == 0o700
        (area / "part").write_text("")
    assert not (dataset / STAGING_DIR).exists()


def test_what_an_interrupted_build_left_is_only_its_own(dataset: Path) -> None:
    with pytest.raises(KeyboardInterrupt), staging(dataset) as area:
        (area / "part").write_text("")
        raise KeyboardInterrupt
    with staging(dataset) as area:
        assert (area / "part").exists()


def test_the_work_of_an_interrupted_command_is_kept_from_others(dataset: Path) -> None:
    with pytest.raises(KeyboardInterrupt), staging(dataset, folder=RENDER_DIR) as area:
        (area / "part").write_text("")
        raise KeyboardInterrupt
    left = contents(dataset)
    advice = r"`branchdrive render` was interrupted and left its work in \.staging/render; run it again to finish it"
    with pytest.raises(UsageError, match=advice):
        build(dataset)
    with pytest.raises(UsageError, match=advice), lock_area(dataset):
        pass
    assert contents(dataset) == left


@pytest.mark.parametrize("mode", [0o755, 0o777, 0o701])
def test_a_working_folder_that_others_could_fill_is_made_anew(dataset: Path, mode: int) -> None:
    area = dataset / STAGING_DIR / "build"
    area.mkdir(parents=True)
    (area / "part").write_text("")
    area.chmod(mode)
    with staging(dataset) as found:
        assert (found, list(found.iterdir())) == (area, [])
        assert stat.S_IMODE(area.stat().st_mode) == 0o700


def test_a_scan_of_a_release_is_unchanged_by_its_own_layers(release: Path) -> None:
    with Spool.temporary() as spool:
        scan = scan_raw(Folder(release), spool, in_process)
    builder.check_unchanged(scan)
    (release / MANIFEST_FILE).unlink()
    with pytest.raises(DatasetError, match="was changed"):
        builder.check_unchanged(scan)
