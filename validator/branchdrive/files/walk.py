"""What lies below the root of a dataset, name by name.

Where links are followed, a folder is entered by one path alone: links could make of one folder as many as they like.
What links do not lead to is walked first, so that it is the link that is refused.

Source: spec/03-layout.md, spec/09-security.md#paths.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, replace

from branchdrive.contract.companion import Companions
from branchdrive.contract.limits import Limits
from branchdrive.contract.mismatch import Mismatch
from branchdrive.errors import UsageError
from branchdrive.formats.store import Entry, Identity, Store

__all__ = ["Tree", "walk"]


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


def walk(dataset: Store, companions: Companions, limits: Limits) -> Tree:
    """Names in a dataset; no folder is left out but those that are companions, too deep, or entered before.

    Raises:
        UsageError: The root went away.
    """
    entries: list[Entry] = []
    num_beside, max_names = 0, 2 * limits.max_files
    plain, linked = [Entry("", "folder")], deque[Entry]()
    entered: set[Identity] = set()
    known: set[str] = set()
    while (plain or linked) and len(entries) <= max_names:
        is_linked = not plain
        folder = linked.popleft() if is_linked else plain.pop()
        if is_linked and folder.identity in entered:
            known.add(folder.path)
            continue
        try:
            opened, found = dataset.entries(folder.path, max_names + 1)
        except OSError as error:
            if folder.path:
                entries.append(Entry(folder.path, "unreadable"))
                continue
            if isinstance(error, FileNotFoundError):
                raise UsageError(
                    f"{str(dataset)!r} went away while it was read; give the folder where it is now"
                ) from error
            raise
        entered.add(opened.identity)
        for entry in found:
            if entry.path in companions:
                num_beside += 1
                continue
            entries.append(entry)
            # One folder below the deepest allowed one, so that what lies too deep is seen.
            if entry.kind == "folder" and entry.path.count("/") <= limits.max_depth:
                (linked if is_linked or entry.is_link else plain).append(entry)
            if len(entries) > max_names:
                break
    entries = [replace(entry, kind="known_folder") if entry.path in known else entry for entry in entries]
    entries.sort(key=lambda entry: entry.path)
    return Tree(tuple(entries), len(entries) > max_names, num_beside, _repeated_bytes(entries))


def _repeated_bytes(entries: Collection[Entry]) -> int:
    sizes = [(entry.identity, entry.size) for entry in entries if entry.kind == "file"]
    return sum(size for _, size in sizes) - sum(dict(sizes).values())
