from __future__ import annotations

import hashlib
import os
import pickle
from pathlib import Path

import pytest

from branchdrive.errors import DatasetError
from branchdrive.formats.folder import Folder
from branchdrive.formats.named_file import read_named_file
from branchdrive.formats.store import Entry


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A folder with a plain file, and with everything that must not be opened."""
    (tmp_path / "secret").write_bytes(b"secret")
    folder = tmp_path / "dataset"
    (folder / "raw").mkdir(parents=True)
    (folder / "raw/plain").write_bytes(b"content")
    (folder / "raw/link").symlink_to(tmp_path / "secret")
    (folder / "raw/up").symlink_to(tmp_path)
    os.mkfifo(folder / "raw/fifo")
    return folder


def test_a_plain_file_is_read(root: Path) -> None:
    assert Folder(root).read("raw/plain", 7) == b"content"


def test_a_root_that_is_a_link_is_followed(root: Path, tmp_path: Path) -> None:
    (tmp_path / "alias").symlink_to(root)
    assert Folder(tmp_path / "alias").read("raw/plain", 7) == b"content"


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("raw/link", "without following links"),
        ("raw/up/secret", "without following links"),
        ("../secret", "leaves its folder"),
        ("raw/fifo", "not a regular file"),
        ("raw", "not a regular file"),
        ("raw/none", "does not exist"),
        ("raw/plain/x", "without following links"),
    ],
)
def test_nothing_else_is_opened(root: Path, path: str, message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        Folder(root).open(path)


def test_a_file_over_the_limit_is_not_read(root: Path) -> None:
    with pytest.raises(DatasetError, match="more than 6 bytes"):
        Folder(root).read("raw/plain", 6)


def test_folders_are_listed_without_following_links(root: Path) -> None:
    assert Folder(root).names("raw") == ["fifo", "link", "plain", "up"]
    assert Folder(root).names("none") == []
    with pytest.raises(DatasetError, match="without following links"):
        Folder(root).names("raw/up")


def test_a_folder_says_what_each_of_its_names_is(root: Path, tmp_path: Path) -> None:
    opened, entries = Folder(root).entries("raw")
    status = (root / "raw").stat()
    assert opened == Entry("raw", "folder", 0, (status.st_dev, status.st_ino))
    assert [(entry.path, entry.kind, entry.size) for entry in entries] == [
        ("raw/fifo", "special", 0),
        ("raw/link", "link", 0),
        ("raw/plain", "file", 7),
        ("raw/up", "link", 0),
    ]
    followed = Folder.at(root, follow_links=True, allow=[tmp_path]).entries("raw")[1]
    assert [(entry.kind, entry.is_link) for entry in followed[1::2]] == [("file", True), ("folder", True)]
    strays = Folder.at(root, follow_links=True).entries("raw")[1]
    assert [entry.kind for entry in strays[1::2]] == ["stray_link", "stray_link"]
    assert len(Folder(root).entries("raw", 2)[1]) == 2


def test_a_folder_that_is_a_link_is_not_entered(root: Path) -> None:
    with pytest.raises(OSError) as caught:
        Folder(root).entries("raw/up")
    assert caught.value.filename == str(root / "raw/up")


def test_status_is_of_the_name_itself(root: Path) -> None:
    kinds = {name: Folder(root).status(f"raw/{name}") for name in ("plain", "link", "none", "plain/x", "up/secret")}
    found = {name: entry.kind if entry else None for name, entry in kinds.items()}
    assert found == {"plain": "file", "link": "link", "none": None, "plain/x": None, "up/secret": None}


def test_a_file_is_replaced_whole_and_removed(root: Path) -> None:
    folder = Folder(root)
    folder.replace("raw/plain", b"new")
    assert folder.digest("raw/plain") == hashlib.sha256(b"new").hexdigest()
    assert folder.names("raw") == ["fifo", "link", "plain", "up"]
    for _ in range(2):
        folder.remove("raw/plain")
        assert folder.status("raw/plain") is None


def test_a_folder_travels_to_other_processes(root: Path) -> None:
    folder = Folder.at(root, follow_links=True, allow=[root])
    assert pickle.loads(pickle.dumps(folder)) == folder


def test_a_file_that_the_user_names_may_lie_anywhere(root: Path) -> None:
    (root / "my file (2)").symlink_to(root / "raw/plain")
    assert read_named_file(root / "my file (2)", 7) == b"content"


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("none", "does not exist"),
        ("raw", "is not a regular file"),
        ("raw/fifo", "is not a regular file"),
        ("raw/plain/x", "cannot be opened"),
        ("nul\0", "cannot be opened"),
        ("raw/plain", "more than 6 bytes"),
    ],
)
def test_a_named_file_that_is_none_is_refused(root: Path, path: str, message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        read_named_file(root / path, 6)
