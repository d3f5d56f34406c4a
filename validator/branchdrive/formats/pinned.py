"""Places that are listed once, when they are opened: every file is then read in the version that was listed."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import islice
from typing import BinaryIO, Literal

from branchdrive.contract.limits import spec_limits
from branchdrive.errors import DatasetError
from branchdrive.formats.store import Entry, Store

__all__ = ["Pinned", "PinnedStore", "most_files"]


def most_files() -> int:
    """Names of a place that are looked at: more than a dataset may have, so that what lies beside it is seen."""
    return 2 * spec_limits().max_files


@dataclass(frozen=True)
class Pinned:
    """What was listed under one name.

    Attributes:
        size: Its bytes.
        kind: What it is; folders need not be listed.
    """

    size: int
    kind: Literal["file", "folder", "link", "special"] = "file"


@dataclass(frozen=True)
class PinnedStore(Store):
    """A place whose names are known.

    A name that no folder could hold (``a//b``, ``../a``) is an entry of the place itself under the whole name. An
    object without bytes whose name is the beginning of others is a mark that some programs leave for a folder.
    """

    @property
    @abstractmethod
    def pinned(self) -> Mapping[str, Pinned]:
        """What was listed, by path relative to the place."""

    @abstractmethod
    def _opened(self, path: str, found: Pinned) -> BinaryIO:
        """The file that was listed as `found`."""

    def __getstate__(self) -> dict[str, object]:
        return {field.name: getattr(self, field.name) for field in fields(self)}  # neither connections nor the tree

    def __setstate__(self, state: Mapping[str, object]) -> None:
        self.__dict__.update(state)

    @cached_property
    def _tree(self) -> dict[str, dict[str, Entry]]:
        """Entries of every folder by name, no deeper than anyone looks."""
        deepest = spec_limits().max_depth + 2
        tree: dict[str, dict[str, Entry]] = {"": {}}
        for path in sorted(self.pinned):
            found, steps = self.pinned[path], path.split("/")
            if not all(step not in ("", ".", "..") for step in steps):
                tree[""][path] = Entry(path, "special" if found.kind == "link" else found.kind, found.size, path)
                continue
            for number in range(1, min(len(steps), deepest + 1)):
                _add(tree, Entry("/".join(steps[:number]), "folder", 0, "/".join(steps[:number])))
            if len(steps) <= deepest:
                size = found.size if found.kind == "file" else 0
                _add(tree, Entry(path, found.kind, size, path, is_link=found.kind == "link"))
        return tree

    def entries(self, path: str = "", most: int | None = None) -> tuple[Entry, list[Entry]]:
        """A folder and what was listed in it; see `Store`."""
        if path not in self._tree:
            raise FileNotFoundError(f"no folder {path!r}")
        here = self._tree[path]
        return Entry(path, "folder", 0, path), [here[name] for name in islice(sorted(here), most)]

    def names(self, path: str) -> list[str]:
        """Sorted names in a folder; see `Store`."""
        self._steps(path)
        return sorted(self._tree.get(path, ()))

    def status(self, path: str) -> Entry | None:
        """What was listed at a path."""
        folder, _, name = path.rpartition("/")
        return self._tree.get(folder, {}).get(name)

    def open(self, path: str) -> BinaryIO:
        """A file for reading, in the version that was listed; see `Store`."""
        self._steps(path)
        found = self.status(path)
        if found is None:
            raise DatasetError(f"{self}: {path!r} does not exist" + (f"; {self.unlisted}" if self.unlisted else ""))
        if found.kind != "file":
            raise DatasetError(f"{self}: {path!r} is not a regular file; put a regular file in its place")
        return self._opened(path, self.pinned[path])


def _add(tree: dict[str, dict[str, Entry]], entry: Entry) -> None:
    """Add an entry to its folder; a file that is a folder too is neither, unless it is a mark of one."""
    folder, _, name = entry.path.rpartition("/")
    before = tree[folder].get(name)
    if before is None or before.kind == entry.kind:
        tree[folder][name] = entry
    elif before.size or entry.size or {before.kind, entry.kind} != {"file", "folder"}:
        tree[folder][name] = Entry(entry.path, "file_and_folder", 0, entry.path)
    elif before.kind == "file":
        tree[folder][name] = entry
    if entry.kind == "folder":
        tree.setdefault(entry.path, {})
