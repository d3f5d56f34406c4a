"""Opening files of a dataset that may be hostile: no link is followed, no device opened, nothing outside reached.

Source: spec/09-security.md#paths.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader, FileIO
from pathlib import Path
from typing import Any

from branchdrive.contract.layout import unsafe_reason
from branchdrive.errors import DatasetError
from branchdrive.formats.file_error import machine_faults

__all__ = ["list_names", "open_file", "read_file", "read_named_file"]


@contextmanager
def _open_folder(root: Path, folders: list[str]) -> Iterator[int]:
    """Descriptor of a folder below `root`, reached step by step without following a link."""
    descriptor = os.open(root, os.O_RDONLY | os.O_DIRECTORY)
    try:
        for folder in folders:
            child = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=descriptor)
            os.close(descriptor)
            descriptor = child
        yield descriptor
    finally:
        os.close(descriptor)


class _File(FileIO):
    """A file whose bytes cannot be had only because of itself, never because of a broken disk.

    Raises:
        PlatformError: The machine failed to read it.
    """

    def __init__(self, descriptor: int, path: Path) -> None:
        super().__init__(descriptor, "rb")
        self._path = path

    def readinto(self, buffer: Any, /) -> int:
        with machine_faults(self._path):
            return super().readinto(buffer)

    def readall(self) -> bytes:
        with machine_faults(self._path):
            return super().readall()


def _parts(root: Path, path: str) -> list[str]:
    reason = unsafe_reason(path)
    if reason is not None:
        raise DatasetError(f"{root}: path {path!r} {reason}; use relative POSIX paths of plain names")
    return path.split("/")


def open_file(root: Path, path: str) -> BufferedReader:
    """Open the regular file `path`, relative to `root`, for reading.

    Raises:
        DatasetError: The path is unsafe, does not exist, or is or crosses a link or a special file.
        PlatformError: The machine is to blame, with too few descriptors for example.
    """
    *folders, name = _parts(root, path)
    try:
        with machine_faults(root / path), _open_folder(root, folders) as folder:
            descriptor = os.open(name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=folder)
    except FileNotFoundError:
        raise DatasetError(f"{root}: {path!r} does not exist") from None
    except OSError as error:
        raise DatasetError(f"{root}: {path!r} cannot be opened without following links ({error.strerror})") from error
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise DatasetError(f"{root}: {path!r} is not a regular file; put a regular file in its place")
    return BufferedReader(_File(descriptor, root / path))


def read_file(root: Path, path: str, max_bytes: int) -> bytes:
    """Content of the regular file `path`, relative to `root`.

    Raises:
        DatasetError: As `open_file`, or the file has more than `max_bytes` bytes.
    """
    with open_file(root, path) as stream:
        content = stream.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise DatasetError(f"{root}: {path!r} has more than {max_bytes} bytes, the spec limit")
    return content


def read_named_file(path: Path, max_bytes: int) -> bytes:
    """Content of a regular file that the user names, wherever it lies and whatever links lead there.

    Raises:
        DatasetError: There is none, it cannot be opened, or it has more than `max_bytes` bytes; the message leaves
            the path to the caller.
    """
    try:
        with machine_faults(path):
            descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except FileNotFoundError:
        raise DatasetError("does not exist") from None
    except (OSError, ValueError) as error:
        raise DatasetError(f"cannot be opened ({getattr(error, 'strerror', None) or error})") from error
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise DatasetError("is not a regular file")
    with os.fdopen(descriptor, "rb") as stream:
        content = stream.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise DatasetError(f"has more than {max_bytes} bytes, the spec limit")
    return content


def list_names(root: Path, path: str) -> list[str]:
    """Sorted names in the folder `path`, relative to `root`; empty if there is no such folder.

    Raises:
        DatasetError: The path is unsafe, or is or crosses a link.
    """
    try:
        with machine_faults(root / path), _open_folder(root, _parts(root, path)) as folder:
            return sorted(os.listdir(folder))  # noqa: PTH208  (pathlib cannot list a descriptor)
    except FileNotFoundError:
        return []
    except OSError as error:
        raise DatasetError(f"{root}: {path!r} cannot be opened without following links ({error.strerror})") from error
