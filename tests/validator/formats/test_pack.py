"""`branchdrive pack`: one archive, equal for equal datasets, whose report is the folder's."""

from __future__ import annotations

import io
import os
import zipfile
from pathlib import Path

import pytest
from tests.validator.engine.datasets import write

from branchdrive.cli.main import run as run_command
from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.engine.validate import validate
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats import pack
from branchdrive.formats.pack import pack_dataset
from branchdrive.formats.place import open_store


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("pack") / "drive")


def files_of(root: Path) -> dict[str, bytes]:
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*") if path.is_file()}


def test_an_archive_holds_the_files_and_the_manifest_last(root: Path, tmp_path: Path) -> None:
    report = pack_dataset(open_store(root), tmp_path / "drive.zip")
    expected = files_of(root)
    with zipfile.ZipFile(tmp_path / "drive.zip") as archive:
        assert archive.testzip() is None
        names = archive.namelist()
        assert {name: archive.read(name) for name in names} == expected
    assert names == [*sorted({*expected} - {MANIFEST_FILE}), MANIFEST_FILE]
    assert report.num_files == len(names)
    assert report.num_bytes == (tmp_path / "drive.zip").stat().st_size
    assert [path.name for path in tmp_path.iterdir()] == ["drive.zip"]


def test_equal_datasets_give_equal_bytes(root: Path, tmp_path: Path) -> None:
    pack_dataset(open_store(root), tmp_path / "one.zip")
    other = write(tmp_path / "another name")
    for path in other.rglob("*"):
        os.utime(path, (1, 1))
        path.chmod(0o700)
    (other / "README.md").write_text("a companion")
    pack_dataset(open_store(other), tmp_path / "two.zip")
    pack_dataset(open_store(tmp_path / "one.zip"), tmp_path / "three.zip")
    one, two, three = ((tmp_path / f"{name}.zip").read_bytes() for name in ("one", "two", "three"))
    assert one == two == three


@pytest.mark.parametrize("wide_from", [1, 3000, 60_000])
def test_large_archives_are_wide(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wide_from: int) -> None:
    monkeypatch.setattr(pack, "WIDE_FROM", wide_from)
    pack_dataset(open_store(root), tmp_path / "drive.zip")
    store = open_store(tmp_path / "drive.zip")
    for path, content in files_of(root).items():
        assert store.read(path, 1 << 30) == content
    with zipfile.ZipFile(tmp_path / "drive.zip") as archive:
        assert archive.testzip() is None


def test_the_command_makes_what_the_validator_takes(root: Path, tmp_path: Path) -> None:
    out, archive = io.StringIO(), tmp_path / "drive.zip"
    assert run_command(["pack", str(root), str(archive)], out, io.StringIO()) == 0
    expected = validate(root)
    assert expected.dataset.identity is not None
    assert f"identity  {expected.dataset.identity}\n" in out.getvalue()
    assert out.getvalue().endswith(f"next      branchdrive-validate {archive}\n")
    found = validate(archive).to_json()
    assert {**found, "dataset": None} == {**expected.to_json(), "dataset": None}


def test_what_is_not_as_the_manifest_says_is_not_packed(tmp_path: Path) -> None:
    root = write(tmp_path / "drive")
    (root / "raw/shard-00000/notes.txt").write_text("x")
    with pytest.raises(DatasetError, match=r"differ in .*notes\.txt"):
        pack_dataset(open_store(root), tmp_path / "drive.zip")
    (root / "raw/shard-00000/notes.txt").unlink()
    table = root / "raw/shard-00000/controls.parquet"
    content = table.read_bytes()
    table.write_bytes(content[:-1] + b"\0")
    with pytest.raises(DatasetError, match=r"controls\.parquet' is not the file that"):
        pack_dataset(open_store(root), tmp_path / "drive.zip")
    table.unlink()
    table.symlink_to("actors.parquet")
    with pytest.raises(DatasetError, match="is a link"):
        pack_dataset(open_store(root), tmp_path / "drive.zip")
    (root / MANIFEST_FILE).unlink()
    with pytest.raises(DatasetError, match="does not exist"):
        pack_dataset(open_store(root), tmp_path / "drive.zip")
    assert [path.name for path in tmp_path.iterdir()] == ["drive"]


def test_nothing_is_overwritten(root: Path, tmp_path: Path) -> None:
    (tmp_path / "drive.zip").write_text("x")
    with pytest.raises(UsageError, match="is there already"):
        pack_dataset(open_store(root), tmp_path / "drive.zip")
    with pytest.raises(UsageError, match="is no name of an archive"):
        pack_dataset(open_store(root), tmp_path / "drive.tar")
    errors = io.StringIO()
    assert run_command(["pack", str(root), str(root / "drive.zip")], io.StringIO(), errors) == 2
    assert "lies inside the dataset" in errors.getvalue()
