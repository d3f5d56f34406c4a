"""Comparisons of what a release stores with what is expected, as checks of rules.

Of a column, computed real numbers agree within the tolerance of `branchdrive.contract.comparison`, copied ones where
they have the same bits, and everything else where it is equal. Source: spec/10-layers.md#derivation.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.comparison import agree
from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.text import quote
from branchdrive.layers.view import ReleaseView
from branchdrive.tables.frame import Alignment, Frame, Values, num_rows

__all__ = [
    "columns_agree",
    "differs",
    "document_check",
    "format_cell",
    "frames_agree",
    "key_of",
    "place",
    "place_in_table",
    "rows_agree",
    "rows_are",
    "text_agrees",
    "text_mismatches",
]

Index = NDArray[np.int64]


def place(view: ReleaseView, table: str, frame: Frame, row: int, column: str | None = None) -> Location:
    """Location of a row: its file where one is known, its table and its key; see `ReleaseView.file_for`."""
    file = view.file_for(table, frame, row)
    found: Location = {"table": table} if file is None else {"file": file, "table": table}
    if column is not None:
        found["column"] = column
    return {**found, **key_of(table, frame, row)}


def place_in_table(view: ReleaseView, table: str) -> Location:
    """Location of a whole table: its file, where it has one alone, and its name."""
    paths = view.paths(table)
    return {"file": paths[0], "table": table} if len(paths) == 1 else {"table": table}


def key_of(table: str, frame: Frame, row: int) -> Location:
    """Key of a row."""
    values = {name: frame[name][row] for name in LAYER_TABLES[table].key}
    return {name: value if isinstance(value, str) else int(value) for name, value in values.items()}


def differs(expected: Values, found: Values, *, exact: bool = False) -> Mask:
    """Cells of a column that do not agree ``[rows]``; null agrees with null alone.

    Args:
        expected: What follows from data, whose type decides how values are compared.
        found: What is stored.
        exact: Whether real numbers are copied, so that they have the same bits; a zero has its sign.
    """
    absent, gone = np.ma.getmaskarray(expected), np.ma.getmaskarray(found)
    a, b = np.ma.getdata(expected), np.ma.getdata(found)
    if a.dtype.kind == "f" and not exact:
        differing = ~agree(a, b)
    elif a.dtype.kind == "f" and b.dtype.kind == "f":
        differing = (a != b) | (np.signbit(a) != np.signbit(b))
    else:
        differing = np.asarray(a != b, bool)
    return np.asarray((absent != gone) | (differing & ~absent & ~gone))


def rows_agree(view: ReleaseView, table: str) -> Iterator[Check]:
    """The stored rows of `table` are those that raw gives, by key: none is missing and none is more."""
    yield from rows_are(view, table, view.expected(table), view.frame(table), view.aligned(table))


def rows_are(view: ReleaseView, table: str, expected: Frame, found: Frame, pairs: Alignment) -> Iterator[Check]:
    """The stored rows are the expected ones, given how both are paired."""
    num_missing = len(pairs.missing)

    def mismatch(i: int) -> Mismatch:
        if i < num_missing:
            return Mismatch(place(view, table, expected, int(pairs.missing[i])), "a row with this key", "no such row")
        row = int(pairs.extra[i - num_missing])
        return Mismatch(place(view, table, found, row), "at most one row with this key", "an unexpected row")

    yield Check(num_rows(expected) + len(pairs.extra), np.arange(num_missing + len(pairs.extra)), mismatch)


def columns_agree(
    view: ReleaseView, table: str, columns: Sequence[str], *, exact: Collection[str] = (), where: Mask | None = None
) -> Iterator[Check]:
    """Stored values of `columns` agree with what raw gives, in every row that both have; one subject a row.

    Args:
        view: The derived layers.
        table: Table to examine.
        columns: Its columns to examine.
        exact: Those of them that are copied, so that real numbers have the same bits.
        where: Which of the paired rows to examine ``[pairs]``; all by default.
    """
    expected, found, pairs = view.expected(table), view.frame(table), view.aligned(table)
    left, right = (pairs.expected, pairs.found) if where is None else (pairs.expected[where], pairs.found[where])
    yield _cells(view, table, columns, expected, found, left, right, exact)


def _cells(
    view: ReleaseView,
    table: str,
    columns: Sequence[str],
    expected: Frame,
    found: Frame,
    left: Index,
    right: Index,
    exact: Collection[str],
) -> Check:
    differing = np.stack([differs(expected[c][left], found[c][right], exact=c in exact) for c in columns], axis=1)
    bad = np.flatnonzero(differing.any(axis=1))

    def mismatch(i: int) -> Mismatch:
        column = columns[int(np.argmax(differing[i]))]
        wanted, value = expected[column][left[i]], found[column][right[i]]
        return Mismatch(place(view, table, found, int(right[i]), column), format_cell(wanted), format_cell(value))

    return Check(len(left), bad, mismatch)


def frames_agree(
    view: ReleaseView, table: str, columns: Sequence[str], expected: Frame, found: Frame, left: Index, right: Index
) -> Iterator[Check]:
    """Values of paired rows are equal: for what follows from stored tables."""
    yield _cells(view, table, columns, expected, found, left, right, columns)


def format_cell(value: Any) -> str:
    """A cell for a finding."""
    return "null" if value is np.ma.masked or value is None else quote(value)


def document_check(path: str, examined: int, mismatches: Iterable[Mismatch] = ()) -> Check:
    """Check of a document at `path`, whose mismatches are located by pointer."""
    return Check.of(examined, (found.within({"file": path}) for found in mismatches))


def text_mismatches(pointer: str, expected: str, found: str) -> Iterator[Mismatch]:
    """A text of a document is the expected one; both are shown as they are."""
    if expected != found:
        yield Mismatch({"pointer": pointer}, expected, found)


def text_agrees(view: ReleaseView, path: str, expected: str) -> Check:
    """A text file says what it must, to the byte; the first line that differs is shown.

    A release must have card and licence, and any other dataset may leave them out.
    """
    if path not in view.contents:
        absent = [Mismatch({"file": path}, "the file", "no such file")] if view.claims("model") else []
        return Check.of(len(absent), absent)
    found = view.contents[path].decode("utf-8", "replace")
    if found == expected:
        return Check.of(1)
    lines = list(zip([*expected.split("\n"), "the end"], [*found.split("\n"), "the end"], strict=False))
    number, (wanted, line) = next((i, pair) for i, pair in enumerate(lines, start=1) if pair[0] != pair[1])
    return Check.of(1, [Mismatch({"file": path, "line": number}, format_cell(wanted), format_cell(line))])
