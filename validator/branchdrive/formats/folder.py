"""A folder as the place of a dataset: what lies in it is listed, read and replaced without trusting a name.

No device is opened, and nothing outside of the folder is reached: files are opened relative to it step by step. A link
is followed only where the caller asks for it, and into folders that the caller names.

Source: spec/09-security.md#paths.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BufferedReader, FileIO
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.durable import replace_file, sync_dir
from branchdrive.formats.file_error import is_machine_fault, machine_faults
from branchdrive.formats.store import Entry, Store

__all__ = ["Folder", "folder_of"]

_ADVICE = "a link is followed with `--follow-links --allow FOLDER`, or `follow_links=True, allow=[FOLDER]`"


def _is_name(step: str) -> bool:
    """Whether a step of a path names something in the folder before it."""
    return step not in ("", ".", "..") and "\0" not in step


@dataclass(frozen=True)
class Folder(Store):
    """The folder of a dataset, and where links in it may lead.

    Attributes:
        root: The folder.
        links: Folders beside it that links may lead into; ``None`` where no link is followed at all.
    """

    root: Path
    links: tuple[Path, ...] | None = None

    @classmethod
    def at(cls, root: str | Path, *, follow_links: bool = False, allow: Iterable[str | Path] = ()) -> Folder:
        """The folder at `root`, whether or not it is there.

        Args:
            root: The folder.
            follow_links: Whether links are followed: those that stay in the folder, and those into `allow`.
            allow: Folders that links may lead into.

        Raises:
            UsageError: Folders are named and links are not followed, or one is no folder.
        """
        folders = tuple(Path(os.path.realpath(folder)) for folder in allow)
        if folders and not follow_links:
            raise UsageError("folders that links may lead into are named, and links are not followed; ask for both")
        for folder in folders:
            if not folder.is_dir():
                raise UsageError(f"{str(folder)!r} is not a folder; name one that links of the dataset lead into")
        return cls(Path(root), folders if follow_links else None)

    @property
    def is_there(self) -> bool:
        """Whether there is such a folder."""
        return self.root.is_dir()

    def place(self, path: str) -> str:
        """The whole path of what is at a path."""
        return str(self.root / path)

    def entries(self, path: str = "", most: int | None = None) -> tuple[Entry, list[Entry]]:
        """A folder as it was opened, and what it holds, sorted by name; the folder itself where `path` is empty.

        Args:
            path: Of whatever name.
            most: Names that are looked at, at most.

        Raises:
            OSError: It is not there, or a link that may not be followed leads there.
            PlatformError: The machine is to blame.
        """
        try:
            with (
                machine_faults(self.root / path),
                self._opened(path.split("/") if path else []) as descriptor,
                os.scandir(descriptor) as listing,
            ):
                names = sorted(islice(listing, most), key=lambda entry: entry.name)
                prefix = f"{path}/" if path else ""
                return _entry_of(path, os.fstat(descriptor)), [self._entry(prefix + name.name, name) for name in names]
        except OSError as error:
            error.filename = os.fspath(self.root / path)  # not the last step alone
            raise

    def names(self, path: str) -> list[str]:
        """Sorted names in a folder; empty if there is no such folder.

        Raises:
            DatasetError: The path is unsafe, or is or crosses a link that may not be followed.
            PlatformError: The machine is to blame.
        """
        with self._refused(path):
            try:
                with self._opened(self._steps(path)) as descriptor:
                    return sorted(os.listdir(descriptor))  # noqa: PTH208  (pathlib cannot list a descriptor)
            except FileNotFoundError:
                return []

    def status(self, path: str) -> Entry | None:
        """What is at a path below the folder; ``None`` where nothing is, or nothing that can be looked at.

        Raises:
            PlatformError: The machine is to blame.
        """
        steps = path.split("/")
        if not all(map(_is_name, steps)):
            return None
        try:
            with machine_faults(self.root / path), self._opened(steps[:-1]) as descriptor:
                return self._entry_at(path, os.stat(steps[-1], dir_fd=descriptor, follow_symlinks=False))
        except OSError:
            return None

    def open(self, path: str) -> BufferedReader:
        """A regular file for reading, whole or by ranges.

        Raises:
            DatasetError: The path is unsafe, does not exist, or is or crosses a link that may not be followed, or a
                special file.
            PlatformError: The machine is to blame, with too few descriptors for example.
        """
        steps = self._steps(path)
        with self._refused(path):
            try:
                descriptor = self._open(steps, os.O_RDONLY | os.O_NONBLOCK)
            except FileNotFoundError:
                raise DatasetError(f"{self}: {path!r} does not exist") from None
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            os.close(descriptor)
            raise DatasetError(f"{self}: {path!r} is not a regular file; put a regular file in its place")
        return BufferedReader(_File(descriptor, self.root / path))

    def version_of(self, stream: BinaryIO) -> tuple[int, ...]:
        """What tells an opened file from another under its name, and from itself after a change."""
        found = os.fstat(stream.fileno())
        return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns

    def replace(self, path: str, content: bytes) -> None:
        """Create or replace a file: durable, and never visible in parts.

        Raises:
            DatasetError: The path is unsafe.
        """
        replace_file(self.root.joinpath(*self._steps(path)), content)

    def remove(self, path: str) -> None:
        """Remove a file, or a link itself, durably; nothing happens if there is none.

        Raises:
            DatasetError: The path is unsafe.
        """
        place = self.root.joinpath(*self._steps(path))
        try:
            place.unlink()
        except FileNotFoundError:
            return
        sync_dir(place.parent)

    @contextmanager
    def _refused(self, path: str) -> Iterator[None]:
        """Let errors of opening a path name it, and say what to do."""
        try:
            with machine_faults(self.root / path):
                yield
        except OSError as error:
            how, advice = (" without following links", f"; {_ADVICE}") if self.links is None else ("", "")
            raise DatasetError(f"{self}: {path!r} cannot be opened{how} ({error.strerror}){advice}") from error

    def _entry(self, path: str, name: os.DirEntry[str]) -> Entry:
        try:
            return self._entry_at(path, name.stat(follow_symlinks=False))
        except OSError as error:
            if is_machine_fault(error):
                raise
            return Entry(path, "unreadable")

    def _entry_at(self, path: str, status: os.stat_result) -> Entry:
        """What a path is whose own status is `status`, or what the link there leads to."""
        if not stat.S_ISLNK(status.st_mode):
            return _entry_of(path, status)
        if self.links is None:
            return Entry(path, "link", is_link=True)
        try:
            return _entry_of(path, self._linked_status(path), is_link=True)
        except OSError as error:
            if is_machine_fault(error):
                raise
            return Entry(path, "stray_link", is_link=True)

    def _linked_status(self, path: str) -> os.stat_result:
        start, steps = self._walk(path.split("/"))
        if not steps:
            return start.stat()
        with Folder(start)._opened(steps[:-1]) as descriptor:
            return os.stat(steps[-1], dir_fd=descriptor, follow_symlinks=False)

    def _walk(self, steps: list[str]) -> tuple[Path, list[str]]:
        """The folder that a walk without links begins at, and its steps.

        Where links may be followed, they are resolved first: the walk then begins at the allowed folder that holds
        what they lead to, so that a link that appears in the meantime is not followed.

        Raises:
            PermissionError: A link leads out of the allowed folders.
        """
        if self.links is None:
            return self.root, steps
        real = os.path.realpath(os.path.join(self.root, *steps))  # noqa: PTH118  (a dataset has many links)
        for base in (os.path.realpath(self.root), *map(str, self.links)):
            if real == base or real.startswith(f"{base.rstrip('/')}/"):
                return Path(base), [step for step in real[len(base) :].split("/") if step]
        raise PermissionError(errno.EACCES, "a link leads out of the folders that are named with `--allow` or `allow`")

    def _open(self, path_steps: list[str], flags: int) -> int:
        """Descriptor of what steps lead to, taken one by one; none of them leads up or nowhere."""
        if not all(map(_is_name, path_steps)):
            raise OSError(errno.EINVAL, "no name of a file or folder", "/".join(path_steps))
        start, steps = self._walk(path_steps)
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
    def _opened(self, steps: list[str]) -> Iterator[int]:
        descriptor = self._open(steps, os.O_RDONLY | os.O_DIRECTORY)
        try:
            yield descriptor
        finally:
            os.close(descriptor)


def folder_of(store: Store, what: str) -> Folder:
    """The folder that a store is, for what no other place can do.

    Args:
        store: The place.
        what: Who needs a folder, as messages name it.

    Raises:
        UsageError: It is another place.
    """
    if not isinstance(store, Folder):
        raise UsageError(f"{store}: {what} needs a folder of this machine; copy the dataset into one")
    return store


def _entry_of(path: str, status: os.stat_result, *, is_link: bool = False) -> Entry:
    identity = status.st_dev, status.st_ino
    if stat.S_ISREG(status.st_mode):
        return Entry(path, "file", status.st_size, identity, is_link)
    if stat.S_ISDIR(status.st_mode):
        return Entry(path, "folder", 0, identity, is_link)
    return Entry(path, "special", is_link=is_link)


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
