from __future__ import annotations

import os
from pathlib import Path

import pytest

from branchdrive.errors import DatasetError
from branchdrive.formats.folder import Folder
from branchdrive.formats.named_file import read_named_file


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
