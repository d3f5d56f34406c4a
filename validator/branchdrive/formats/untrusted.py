"""Opening files of a dataset that may be hostile: no device is opened, and nothing outside of it is reached.

A link is followed only where the caller asks for it, and into folders that the caller names.

Source: spec/09-security.md#paths.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import BufferedReader, FileIO
from pathlib import Path
from typing import Any, TypeAlias

from branchdrive.contract.layout import unsafe_reason
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.file_error import machine_faults

__all__ = [
    "Links", "linked_folders", "linked_status", "list_names", "open_file", "open_folder", "read_file",
    "read_named_file",
]  # fmt: skip

Links: TypeAlias = tuple[Path, ...] | None
"""Folders beside the dataset that links in it may lead into; ``None`` where no link is followed at all."""

_ADVICE = "a link is followed with `--follow-links --allow FOLDER`, or `follow_links=True, allow=[FOLDER]`"


def linked_folders(follow_links: bool, allow: Iterable[str | Path]) -> Links:
    """The folders that links may lead into, beside the dataset's own; ``None`` where links are not followed.

    Raises:
        UsageError: Folders are named and links are not followed, or one is no folder.
    """
    folders = tuple(Path(os.path.realpath(folder)) for folder in allow)
    if folders and not follow_links:
        raise UsageError("folders that links may lead into are named, and links are not followed; ask for both")
    for folder in folders:
        if not folder.is_dir():
            raise UsageError(f"{str(folder)!r} is not a folder; name one that links of the dataset lead into")
    return folders if follow_links else None


def _place(root: Path, parts: list[str], links: Links) -> tuple[Path, list[str]]:
    """The folder that a walk without links begins at, and its steps.

    Where links may be followed, they are resolved first: the walk then begins at the allowed folder that holds what
    they lead to, so that a link that appears in the meantime is not followed.

    Raises:
        PermissionError: A link leads out of the allowed folders.
    """
    if links is None:
        return root, parts
    real = os.path.realpath(os.path.join(root, *parts))  # noqa: PTH118  (a dataset has many links)
    for base in (os.path.realpath(root), *map(str, links)):
        if real == base or real.startswith(f"{base.rstrip('/')}/"):
            return Path(base), [step for step in real[len(base) :].split("/") if step]
    raise PermissionError(errno.EACCES, "a link leads out of the folders that are named with `--allow` or `allow`")


def _open(root: Path, parts: list[str], links: Links, flags: int) -> int:
    """Descriptor of what the path of `parts` below `root` leads to, reached step by step."""
    start, steps = _place(root, parts, links)
    descriptor = os.open(start, os.O_RDONLY | os.O_DIRECTORY)
    for number, step in enumerate(steps, start=1):
        step_flags = flags if number == len(steps) else os.O_RDONLY | os.O_DIRECTORY
        try:
            child = os.open(step, step_flags | os.O_NOFOLLOW, dir_fd=descriptor)
        finally:
            os.close(descriptor)
        descriptor = child
    return descriptor


@contextmanager
def open_folder(root: Path, path: str, links: Links = None) -> Iterator[int]:
    """Descriptor of the folder `path` below `root`, of whatever name; of `root` itself where it is empty.

    Raises:
        OSError: It is not there, or a link that may not be followed leads there.
    """
    descriptor = _open(root, path.split("/") if path else [], links, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def linked_status(root: Path, path: str, links: tuple[Path, ...]) -> os.stat_result:
    """Status of what the link `path` below `root` leads to.

    Raises:
        OSError: It leads nowhere, or out of the folders that it may lead into.
    """
    start, steps = _place(root, path.split("/"), links)
    if not steps:
        return start.stat()
    with open_folder(start, "/".join(steps[:-1])) as folder:
        return os.stat(steps[-1], dir_fd=folder, follow_symlinks=False)


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


def open_file(root: Path, path: str, links: Links = None) -> BufferedReader:
    """Open the regular file `path`, relative to `root`, for reading.

    Raises:
        DatasetError: The path is unsafe, does not exist, or is or crosses a link that may not be followed, or a
            special file.
        PlatformError: The machine is to blame, with too few descriptors for example.
    """
    parts = _parts(root, path)
    try:
        with machine_faults(root / path):
            descriptor = _open(root, parts, links, os.O_RDONLY | os.O_NONBLOCK)
    except FileNotFoundError:
        raise DatasetError(f"{root}: {path!r} does not exist") from None
    except OSError as error:
        raise DatasetError(f"{root}: {path!r} {_refusal(error, links)}") from error
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise DatasetError(f"{root}: {path!r} is not a regular file; put a regular file in its place")
    return BufferedReader(_File(descriptor, root / path))


def _refusal(error: OSError, links: Links) -> str:
    if links is None:
        return f"cannot be opened without following links ({error.strerror}); {_ADVICE}"
    return f"cannot be opened ({error.strerror})"


def read_file(root: Path, path: str, max_bytes: int, links: Links = None) -> bytes:
    """Content of the regular file `path`, relative to `root`.

    Raises:
        DatasetError: As `open_file`, or the file has more than `max_bytes` bytes.
    """
    with open_file(root, path, links) as stream:
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


def list_names(root: Path, path: str, links: Links = None) -> list[str]:
    """Sorted names in the folder `path`, relative to `root`; empty if there is no such folder.

    Raises:
        DatasetError: The path is unsafe, or is or crosses a link that may not be followed.
    """
    try:
        with machine_faults(root / path), open_folder(root, "/".join(_parts(root, path)), links) as folder:
            return sorted(os.listdir(folder))  # noqa: PTH208  (pathlib cannot list a descriptor)
    except FileNotFoundError:
        return []
    except OSError as error:
        raise DatasetError(f"{root}: {path!r} {_refusal(error, links)}") from error
