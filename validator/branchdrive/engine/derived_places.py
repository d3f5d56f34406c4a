"""Whether rows of derived tables lie in the files that they belong in.

A file holds the rows of one partition and of the groups of one part, whose records name their shards.
Source: spec/10-layers.md (BD-LYR-010).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.layer import part_of, paths_by_table, table_file, table_path, table_paths
from branchdrive.contract.mismatch import Location, Mismatch
from branchdrive.contract.text import counted, quote
from branchdrive.engine.spool import Spool, spooled_table
from branchdrive.tables.view import TableView

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["GroupsTask", "empty_parts", "find_groups", "foreign_groups", "misplaced", "records_elsewhere", "strays"]


def strays(path: str, table: pa.Table) -> Iterator[Mismatch]:
    """Rows of a file that are of another partition than the one that it is for: the first of them, and how many."""
    file = table_file(path)
    if file is None or file.partition is None:
        return
    codes, texts = TableView(file.table, table).categories("partition")
    is_other = np.array([text != file.partition for text in texts] + [False], bool)  # a null is another rule's
    for found in _first(file.table, "partition", codes, texts, is_other, f"rows of {file.partition!r} alone"):
        yield found.within({"file": path})


def records_elsewhere(part: int, tables: Mapping[str, pa.Table]) -> Iterator[Mismatch]:
    """Records among the `tables` of a part, by path, whose shard is of another part."""
    for path in table_paths("records", tables):
        codes, folders = TableView("records", tables[path]).categories("shard")
        is_other = np.array([_part_of(folder) not in (None, part) for folder in folders] + [False], bool)
        for found in _first("records", "shard", codes, folders, is_other, f"rows of shards of part {part}"):
            yield found.within({"file": path})


def foreign_groups(tables: Mapping[str, pa.Table]) -> dict[str, dict[str, tuple[int, int]]]:
    """First row, and number of rows, of each group that has no record among the `tables` of its part, by path."""
    groups: set[str] = set()
    for path in table_paths("records", tables):
        groups.update(TableView("records", tables[path]).categories("group_id")[1])
    foreign: dict[str, dict[str, tuple[int, int]]] = {}
    for path, table in tables.items():
        if (file := table_file(path)) is None:
            continue
        codes, texts = TableView(file.table, table).categories("group_id")
        unknown = [place for place, text in enumerate(texts) if text not in groups]
        if unknown:
            rows = np.flatnonzero(codes >= 0)
            counts, first = np.bincount(codes[rows], minlength=len(texts)), np.zeros(len(texts), np.int64)
            first[codes[rows[::-1]]] = rows[::-1]  # the first row is written last
            foreign[path] = {
                texts[place]: (int(first[place]), int(counts[place])) for place in unknown if counts[place]
            }
    return foreign


@dataclass(frozen=True)
class GroupsTask:
    """Groups to find among the records.

    Attributes:
        spool: Where the records are.
        files: Paths of the files of records.
        groups: Identities of the groups.
    """

    spool: Spool
    files: tuple[str, ...]
    groups: frozenset[str]


def find_groups(task: GroupsTask) -> dict[str, int]:
    """Number of the last part with records of each of the groups that have any."""
    found: dict[str, int] = {}
    for path in task.files:
        file = table_file(path)
        if file is not None and file.part is not None:
            texts = TableView("records", task.spool.table(spooled_table(path))).categories("group_id")[1]
            found |= dict.fromkeys(task.groups & {*texts}, file.part)
    return found


def misplaced(foreign: Mapping[str, Mapping[str, tuple[int, int]]], homes: Mapping[str, int]) -> Iterator[Mismatch]:
    """Files with rows of groups that have their records in another part.

    Args:
        foreign: What `foreign_groups` found.
        homes: Number of the part with the records of groups that have none in the part of a file.
    """
    for path, groups in sorted(foreign.items()):
        file = table_file(path)
        if file is None:
            continue
        others = {group: rows for group, rows in groups.items() if homes.get(group, file.part) != file.part}
        if others:
            first = min(others, key=lambda group: others[group][0])
            where: Location = {"file": path, "table": file.table, "column": "group_id", "row": others[first][0]}
            num_rows = sum(count for _, count in others.values())
            found = f"{counted(num_rows, 'row')} of others, the first of {quote(first)} in part {homes[first]}"
            yield Mismatch(where, f"rows of groups of part {file.part} alone", found)


def empty_parts(num_rows: Mapping[str, int]) -> Iterator[Mismatch]:
    """Files without rows that no rule admits, of those whose rows are counted by path.

    Part 0 alone may be empty, of a table or partition that has no rows at all.
    """
    for name, paths in paths_by_table(num_rows).items():
        if not LAYER_TABLES[name].is_of_groups:
            continue
        for partition in LAYER_TABLES[name].partitions or (None,):
            own = [path for path in paths if (file := table_file(path)) and file.partition == partition]
            is_empty = not any(num_rows[path] for path in own)
            for path in own:
                if not num_rows[path] and not (is_empty and path == table_path(name, partition)):
                    yield Mismatch({"file": path, "table": name}, "a part with rows, or no file", "no row")


def _part_of(folder: str) -> int | None:
    try:
        return part_of(folder)
    except ValueError:  # another rule's
        return None


def _first(
    table: str,
    column: str,
    codes: NDArray[np.int32],
    texts: Sequence[str],
    is_other: NDArray[np.bool_],
    expected: str,
) -> Iterator[Mismatch]:
    """The first row of a text that is another than it should be, and how many there are; null is the last code."""
    rows = np.flatnonzero(is_other[codes])
    if len(rows):
        where: Location = {"table": table, "column": column, "row": int(rows[0])}
        found = f"{counted(len(rows), 'row')} of others, the first of {quote(texts[codes[rows[0]]])}"
        yield Mismatch(where, expected, found)
