"""A place of a dataset: a folder, a bucket, an archive. What lies in it is listed and read without trusting a name.

Source: spec/09-security.md#paths.
"""

from __future__ import annotations

import hashlib
import io
from abc import ABC, abstractmethod
from collections.abc import Collection
from dataclasses import dataclass
from typing import BinaryIO, Literal, TypeAlias

from branchdrive.contract.layout import unsafe_reason
from branchdrive.errors import DatasetError

__all__ = ["Entry", "Identity", "Store", "digest_of", "size_of"]

Identity: TypeAlias = tuple[int, int] | str
"""Device and inode, equal for all names of one file or folder; its only name, where a place has one for each."""

_NOTHING: Identity = (0, 0)

_PIECE_BYTES = 1 << 20


@dataclass(frozen=True)
class Entry:
    """One name below a place; a link that is followed is what it leads to.

    Attributes:
        path: Relative to the place.
        kind: A stray link may not be followed; a folder that is known is reached by another path too; a file and
            folder is an object whose key is the beginning of other keys.
        size: Bytes of a file; 0 of anything else.
        identity: What tells a file or folder from others.
        is_link: Whether a link leads there.
    """

    path: str
    kind: Literal["file", "folder", "known_folder", "file_and_folder", "link", "stray_link", "special", "unreadable"]
    size: int = 0
    identity: Identity = _NOTHING
    is_link: bool = False


class Store(ABC):
    """Where a dataset is. All readers use this value, which travels to workers.

    All that is read of a file after it was listed or opened is of one version; of another, it raises `DatasetError`.
    """

    @property
    def is_there(self) -> bool:
        """Whether there is such a place; one that was listed when it was opened is."""
        return True

    @property
    def lists_all(self) -> bool:
        """Whether files are seen that the manifest does not name."""
        return True

    @property
    def unlisted(self) -> str:
        """Why its names could not be listed to the end; empty where they could."""
        return ""

    @abstractmethod
    def place(self, path: str) -> str:
        """How messages name what is at a path; the place itself where `path` is empty."""

    def __str__(self) -> str:
        return self.place("")

    @abstractmethod
    def entries(self, path: str = "", most: int | None = None) -> tuple[Entry, list[Entry]]:
        """A folder and what it holds, sorted by name; the place itself where `path` is empty.

        Args:
            path: Of whatever name.
            most: Names that are looked at, at most.

        Raises:
            OSError: It is not there, or cannot be listed.
            PlatformError: The machine is to blame.
        """

    @abstractmethod
    def names(self, path: str) -> list[str]:
        """Sorted names in a folder; empty if there is no such folder.

        Raises:
            DatasetError: The path is unsafe, or cannot be listed.
            PlatformError: The machine is to blame.
        """

    @abstractmethod
    def status(self, path: str) -> Entry | None:
        """What is at a path; ``None`` where nothing is, or nothing that can be looked at.

        Raises:
            PlatformError: The machine is to blame.
        """

    @abstractmethod
    def open(self, path: str) -> BinaryIO:
        """A regular file for reading, whole or by ranges.

        Raises:
            DatasetError: The path is unsafe, does not exist, is no regular file, or is not what was listed.
            PlatformError: The machine is to blame, with too few descriptors for example, or what serves the place.
        """

    def version_of(self, stream: BinaryIO) -> tuple[int, ...]:  # noqa: ARG002  (a place that was listed knows by itself)
        """What tells an opened file from another under its name, and from itself after a change."""
        return ()

    @property
    def has_versions(self) -> bool:
        """Whether this place is one of many that say of a listed file which version of it was listed."""
        return False

    def lasting_version(self, path: str) -> str | None:  # noqa: ARG002  (of most places, none is known)
        """What tells the listed version of a file from every other one of any time, and from files of other places.

        ``None`` where the place does not say so; it says nothing of what bytes the version has.
        """
        return None

    def only(self, paths: Collection[str]) -> Store:  # noqa: ARG002  (all are there, where none were listed)
        """The same place for who reads these files of it alone: what travels to a worker is no larger than its task."""
        return self

    def read(self, path: str, max_bytes: int) -> bytes:
        """Content of a regular file.

        Raises:
            DatasetError: As `open`, or the file has more than `max_bytes` bytes.
        """
        with self.open(path) as stream:
            content = stream.read(max_bytes + 1)
        if len(content) > max_bytes:
            raise DatasetError(f"{self}: {path!r} has more than {max_bytes} bytes, the spec limit")
        return content

    def digest(self, path: str) -> str:
        """SHA-256 of a regular file, hexadecimal; errors as `open`."""
        with self.open(path) as stream:
            return digest_of(stream)

    def _steps(self, path: str) -> list[str]:
        """Parts of a safe path.

        Raises:
            DatasetError: It is not safe.
        """
        reason = unsafe_reason(path)
        if reason is not None:
            raise DatasetError(f"{self}: path {path!r} {reason}; use relative POSIX paths of plain names")
        return path.split("/")


def digest_of(stream: BinaryIO) -> str:
    """SHA-256 of the rest of an opened file, hexadecimal."""
    digest = hashlib.sha256()
    while piece := stream.read(_PIECE_BYTES):
        digest.update(piece)
    return digest.hexdigest()


def size_of(stream: BinaryIO) -> int:
    """Bytes of an opened file, which is left where it is."""
    place = stream.tell()
    size = stream.seek(0, io.SEEK_END)
    stream.seek(place)
    return size
