"""What lies below the root of a dataset, name by name.

Where links are followed, a folder is entered by one path alone: links could make of one folder as many as they like.
What links do not lead to is walked first, so that it is the link that is refused.

Source: spec/03-layout.md, spec/09-security.md#paths.
"""

from __future__ import annotations

import os
import stat
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Literal, TypeAlias

from branchdrive.contract.companion import Companions
from branchdrive.contract.limits import Limits
from branchdrive.contract.mismatch import Mismatch
from branchdrive.errors import UsageError
from branchdrive.formats.file_error import is_machine_fault, machine_faults
from branchdrive.formats.untrusted import Links, linked_status, open_folder

__all__ = ["Entry", "Tree", "walk"]

_Identity: TypeAlias = tuple[int, int]
"""Device and inode: equal for all names of one file or folder."""

_NOTHING: _Identity = (0, 0)


@dataclass(frozen=True)
class Entry:
    """One name below the root; a link that is followed is what it leads to.

    Attributes:
        path: Relative to the root.
        kind: A stray link may not be followed; a folder that is known is reached by another path too.
        size: Bytes of a file; 0 of anything else.
        identity: Device and inode of a file or folder.
    """

    path: str
    kind: Literal["file", "folder", "known_folder", "link", "stray_link", "special", "unreadable"]
    size: int = 0
    identity: _Identity = _NOTHING


@dataclass(frozen=True)
class Tree:
    """All names below a root that are no companions.

    Attributes:
        entries: Sorted by path; cut off at twice the limit on files.
        is_cut: Whether `entries` is cut off.
        num_beside: Names that are companions; what lies in them was not looked at.
        num_repeated_bytes: Bytes of files that further paths lead to, counted for every path but the first.
    """

    entries: tuple[Entry, ...]
    is_cut: bool
    num_beside: int
    num_repeated_bytes: int

    def excess(self, limits: Limits) -> tuple[Mismatch, ...]:
        """How the files exceed the limits together."""
        num_files = sum(entry.kind == "file" for entry in self.entries)
        found = []
        if self.is_cut or num_files > limits.max_files:
            found.append(Mismatch({}, f"at most {limits.max_files} files", f"{len(self.entries)} names or more"))
        if self.num_repeated_bytes > limits.max_repeated_bytes:
            expected = f"at most {limits.max_repeated_bytes} bytes that further paths of the same files lead to"
            found.append(Mismatch({}, expected, f"{self.num_repeated_bytes} bytes"))
        return tuple(found)


def walk(root: Path, links: Links, companions: Companions, limits: Limits) -> Tree:
    """Names below `root`; no folder is left out but those that are companions, too deep, or entered before.

    Raises:
        UsageError: The root went away.
    """
    entries: list[Entry] = []
    num_beside, max_names = 0, 2 * limits.max_files
    plain, linked = [Entry("", "folder")], deque[Entry]()
    entered: set[_Identity] = set()
    known: set[str] = set()
    while (plain or linked) and len(entries) <= max_names:
        is_linked = not plain
        folder = linked.popleft() if is_linked else plain.pop()
        if is_linked and folder.identity in entered:
            known.add(folder.path)
            continue
        try:
            identity, found = _listed(root, folder.path, links, max_names)
        except OSError as error:
            if folder.path:
                entries.append(Entry(folder.path, "unreadable"))
                continue
            if isinstance(error, FileNotFoundError):
                raise UsageError(
                    f"{str(root)!r} went away while it was read; give the folder where it is now"
                ) from error
            raise
        entered.add(identity)
        for entry, is_link in found:
            if entry.path in companions:
                num_beside += 1
                continue
            entries.append(entry)
            # One folder below the deepest allowed one, so that what lies too deep is seen.
            if entry.kind == "folder" and entry.path.count("/") <= limits.max_depth:
                (linked if is_linked or is_link else plain).append(entry)
            if len(entries) > max_names:
                break
    entries = [replace(entry, kind="known_folder") if entry.path in known else entry for entry in entries]
    entries.sort(key=lambda entry: entry.path)
    return Tree(tuple(entries), len(entries) > max_names, num_beside, _repeated_bytes(entries))


def _listed(root: Path, folder: str, links: Links, max_names: int) -> tuple[_Identity, list[tuple[Entry, bool]]]:
    """Identity of a folder, and what it holds, sorted by name, with whether a link leads there."""
    with (
        machine_faults(root / folder),
        open_folder(root, folder, links) as descriptor,
        os.scandir(descriptor) as listing,
    ):
        names = sorted(islice(listing, max_names + 1), key=lambda entry: entry.name)
        prefix = f"{folder}/" if folder else ""
        return _identity(os.fstat(descriptor)), [_entry(root, prefix + name.name, name, links) for name in names]


def _entry(root: Path, path: str, name: os.DirEntry[str], links: Links) -> tuple[Entry, bool]:
    try:
        status = name.stat(follow_symlinks=False)
    except OSError as error:
        if is_machine_fault(error):
            raise
        return Entry(path, "unreadable"), False
    if not stat.S_ISLNK(status.st_mode):
        return _of_status(path, status), False
    if links is None:
        return Entry(path, "link"), True
    try:
        return _of_status(path, linked_status(root, path, links)), True
    except OSError as error:
        if is_machine_fault(error):
            raise
        return Entry(path, "stray_link"), True


def _of_status(path: str, status: os.stat_result) -> Entry:
    if stat.S_ISREG(status.st_mode):
        return Entry(path, "file", status.st_size, _identity(status))
    return Entry(path, "folder", identity=_identity(status)) if stat.S_ISDIR(status.st_mode) else Entry(path, "special")


def _identity(status: os.stat_result) -> _Identity:
    return status.st_dev, status.st_ino


def _repeated_bytes(entries: Collection[Entry]) -> int:
    sizes = [(entry.identity, entry.size) for entry in entries if entry.kind == "file"]
    return sum(size for _, size in sizes) - sum(dict(sizes).values())
