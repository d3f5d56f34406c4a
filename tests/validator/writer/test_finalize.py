"""What `finalize` seals, what it refuses to seal, and what can happen while it does."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from tests.each import each
from tests.validator.writer.invented import make_descriptor, write_dataset, write_group, write_rollout

from branchdrive.contract.layout import MANIFEST_FILE, STAGING_DIR
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import Manifest, build_manifest, write_manifest
from branchdrive.writer import writer as writer_module
from branchdrive.writer.group_writer import GroupWriter
from branchdrive.writer.writer import DatasetWriter


def open_writer(root: Path) -> DatasetWriter:
    return DatasetWriter(root, make_descriptor(), groups_per_shard=2)


def contents(root: Path) -> dict[str, bytes]:
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*") if path.is_file()}


def test_a_finished_dataset_is_left_as_it_is(tmp_path: Path) -> None:
    identity = write_dataset(tmp_path, 3)
    before = contents(tmp_path)
    written_ns = (tmp_path / MANIFEST_FILE).stat().st_mtime_ns
    with open_writer(tmp_path) as writer:
        assert writer.is_finished
        assert writer.finalize() == identity
    assert contents(tmp_path) == before
    assert (tmp_path / MANIFEST_FILE).stat().st_mtime_ns == written_ns


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished dataset of three groups; read-only by agreement."""
    root = tmp_path_factory.mktemp("finished")
    write_dataset(root, 3)
    return root


def misstate_the_identity(root: Path) -> None:
    stated = build_manifest(Folder(root))
    write_manifest(Folder(root), replace(stated, identity="0" * 64))


def flip_a_byte(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[100] ^= 1
    path.write_bytes(content)


DAMAGES: dict[str, Callable[[Path], object]] = {
    "a byte differs": lambda root: flip_a_byte(root / "raw/shard-00000/controls.parquet"),
    "a file is missing": lambda root: (root / "raw/shard-00001/controls.parquet").unlink(),
    "a file is not listed": lambda root: (root / "raw/notes.txt").write_text(""),
    "the identity differs": misstate_the_identity,
    "the manifest is cut off": lambda root: (root / MANIFEST_FILE).write_bytes(b"# branchdrive-manifest 0.1\n"),
}


@each("damage", DAMAGES)
def test_a_finished_dataset_that_differs_from_its_manifest_is_refused(
    finished: Path, tmp_path_factory: pytest.TempPathFactory, damage: str
) -> None:
    root = shutil.copytree(finished, tmp_path_factory.mktemp("damaged") / "dataset")
    DAMAGES[damage](root)
    before = contents(root)
    with pytest.raises(DatasetError, match=r"is finished, but .* from MANIFEST.sha256"):
        open_writer(root)
    assert contents(root) == before


FOREIGN = ("notes.txt", "raw/notes.txt", "raw/shard-00000/media.tar", "raw/shard-00009/x.csv", "model/m.bin", ".x")


def test_a_foreign_file_is_not_sealed(tmp_path: Path) -> None:
    identity = write_dataset(tmp_path / "expected", 1)
    root = tmp_path / "d"
    with open_writer(root) as writer:
        with writer.begin_group("g0") as group:
            write_group(group)
        writer.commit()
        for path in FOREIGN:
            (root / path).parent.mkdir(parents=True, exist_ok=True)
            (root / path).write_text("foreign")
            with pytest.raises(UsageError, match=rf"\['{path}'\] have no place"):
                writer.finalize()
            assert not (root / MANIFEST_FILE).exists()
            (root / path).unlink()
            if not any((root / path).parent.iterdir()):
                (root / path).parent.rmdir()
        assert writer.finalize() == identity


def test_a_foreign_file_in_a_shard_is_not_lost_in_its_replacement(tmp_path: Path) -> None:
    write_dataset(tmp_path, 2)
    with open_writer(tmp_path) as writer:
        with writer.begin_group("g1") as group:
            write_rollout(group, "intervention", "brake_0.50")
        (tmp_path / "raw/shard-00000/media.tar").write_text("foreign")
        with pytest.raises(UsageError, match=r"\['raw/shard-00000/media.tar'\] have no place"):
            writer.finalize()
    assert (tmp_path / "raw/shard-00000/media.tar").read_text() == "foreign"


def test_no_second_writer_opens_while_the_manifest_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    late: list[threading.Thread] = []
    refusals: list[Exception] = []

    def write_late_group() -> None:
        try:
            GroupWriter(tmp_path, make_descriptor(), "late", 1)
        except UsageError as error:
            refusals.append(error)

    def write_at_the_seam(dataset: Folder, manifest: Manifest) -> None:
        assert (dataset.root / STAGING_DIR / "writer.lock").exists()
        with pytest.raises(UsageError, match="another `DatasetWriter` has"):
            open_writer(dataset.root)
        late.append(threading.Thread(target=write_late_group))
        late[0].start()
        late[0].join(0.1)
        assert late[0].is_alive()
        write_manifest(dataset, manifest)

    monkeypatch.setattr(writer_module, "write_manifest", write_at_the_seam)
    with open_writer(tmp_path) as writer:
        with writer.begin_group("g0") as group:
            write_group(group)
        identity = writer.finalize()
    late[0].join(10)
    assert [str(error) for error in refusals] == [
        f"{tmp_path}: open the dataset with `DatasetWriter` before writing groups"
    ]
    assert not (tmp_path / STAGING_DIR).exists()
    assert build_manifest(Folder(tmp_path)).identity == identity


def test_a_manifest_that_cannot_be_written_costs_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_root: Path, _manifest: Manifest) -> None:
        raise OSError("disk full")

    with open_writer(tmp_path / "d") as writer:
        with writer.begin_group("g0") as group:
            write_group(group)
        with monkeypatch.context() as patch, pytest.raises(OSError, match="disk full"):
            patch.setattr(writer_module, "write_manifest", fail)
            writer.finalize()
        with pytest.raises(UsageError, match="another `DatasetWriter` has"):
            open_writer(tmp_path / "d")
        assert writer.finalize() == write_dataset(tmp_path / "expected", 1)


def test_closing_never_removes_staged_groups(tmp_path: Path) -> None:
    with open_writer(tmp_path) as writer:
        with writer.begin_group("g0") as group:
            write_group(group)
        write_manifest(Folder(tmp_path), build_manifest(Folder(tmp_path)))
    (tmp_path / MANIFEST_FILE).unlink()
    with open_writer(tmp_path) as writer:
        assert writer.is_closed("g0")
