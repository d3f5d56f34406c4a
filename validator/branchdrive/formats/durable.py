"""File operations that survive a killed process and a power cut: written, synchronised, then renamed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from branchdrive.formats.file_error import named

__all__ = [
    "delete",
    "durable_stream",
    "make_dir",
    "move",
    "partial_path",
    "remove",
    "replace_file",
    "sync_dir",
    "write_file",
]


def sync_dir(folder: Path) -> None:
    """Make the names in `folder` durable."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with named(folder):
            os.fsync(descriptor)
    finally:
        os.close(descriptor)


def make_dir(folder: Path) -> None:
    """Create `folder` durably; its parent must exist, and so may the folder itself."""
    if not folder.is_dir():
        folder.mkdir(exist_ok=True)
        sync_dir(folder.parent)


def write_file(path: Path, content: bytes | memoryview) -> None:
    """Write a file and make its content durable; see `durable_stream`."""
    with durable_stream(path) as stream:
        stream.write(content)


@contextmanager
def durable_stream(path: Path) -> Iterator[BinaryIO]:
    """A file to write, whose content is made durable in the end; its name is once the folder is synchronised.

    A file that does not get all its content, on a full disk for example, is removed; one that cannot be opened stays.
    """
    with named(path), path.open("wb") as stream:
        try:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        except OSError:
            with suppress(OSError):  # the first error is the one that counts
                path.unlink()
            raise


def partial_path(path: Path) -> Path:
    """Where a file or folder is prepared before it gets its name; starts with a dot, as no identifier does."""
    return path.with_name(f".{path.name}.partial")


def replace_file(path: Path, content: bytes) -> None:
    """Create or replace a file so that a reader sees the old or the new content, whole."""
    partial = partial_path(path)
    try:
        write_file(partial, content)
    except OSError as error:
        error.filename = os.fspath(path)  # the name that the caller knows
        raise
    move(partial, path)


def move(source: Path, target: Path) -> None:
    """Rename durably inside one file system; an existing file at `target` is replaced."""
    source.rename(target)
    sync_dir(target.parent)
    if source.parent != target.parent:
        sync_dir(source.parent)


def delete(path: Path) -> None:
    """Delete a file or a folder with all it holds; nothing happens if there is none."""
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def remove(folder: Path, trash_dir: Path) -> None:
    """Remove a folder so that it leaves its place at once, whole, and is then deleted inside `trash_dir`."""
    doomed = trash_dir / folder.name
    delete(doomed)
    move(folder, doomed)
    delete(doomed)
