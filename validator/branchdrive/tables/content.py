"""Digests of what tables say: blocks of rows in the order of their key, column by column, for any writer.

Source: spec/03-layout.md#content.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import Column, declared_table
from branchdrive.tables.view import TableView

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["block_digests", "sortable", "table_digest"]

Index = NDArray[np.int64]
_TYPES = {"bool": "?", "int32": "<i4", "int64": "<i8", "float32": "<f4", "float64": "<f8"}

_BLOCKS_AT_ONCE = 1 << 15

_CELLS_PER_RUN = 8
"""Blocks times texts, by runs of a text, up to which the texts of blocks are marked in a table of both."""


def table_digest(name: str, table: pa.Table) -> str:
    """SHA-256 of all rows of a table with the declared columns, hexadecimal."""
    view = TableView(name, table)
    key = [sortable(view, column) for column in declared_table(name).key]
    (digest,) = block_digests(view, key, np.array([0, len(view)]))
    return digest.hex()


def block_digests(view: TableView, key: Sequence[NDArray[Any]], bounds: Index) -> list[bytes]:
    """SHA-256 of blocks of rows in ascending order of a key, rows that share one in that of their own digests.

    Args:
        view: The table.
        key: Columns that rows are sorted by, the first first; each ``[rows]``. None where rows are in order.
        bounds: First row of each block in this order, and the number of rows ``[blocks + 1]``.
    """
    order = _order(view, key)
    return _digests(view if order is None else TableView(view.name, view.arrow, order), bounds)


def _digests(view: TableView, bounds: Index) -> list[bytes]:
    """SHA-256 of blocks of rows, each from its bound to the next."""
    starts = range(0, len(bounds) - 1, _BLOCKS_AT_ONCE)
    parts = [bounds[start : start + _BLOCKS_AT_ONCE + 1] for start in starts]
    return [digest for part in parts for digest in _digests_at_once(view, part)]


def _digests_at_once(view: TableView, bounds: Index) -> Iterator[bytes]:
    columns = declared_table(view.name).columns
    pieces = [(values, ends.tolist()) for column in columns for values, ends in _pieces(view, column, bounds)]
    for i, num_rows in enumerate(np.diff(bounds).tolist()):
        block = hashlib.sha256(f"{view.name} {num_rows}\n".encode())
        for values, ends in pieces:
            block.update(values[ends[i] : ends[i + 1]].data)
        yield block.digest()


def _pieces(view: TableView, column: Column, bounds: Index) -> Iterator[tuple[NDArray[Any], Index]]:
    """What blocks have of a column: where it has values if it may lack them, and the values, zeros where it lacks them.

    Yields:
        Values of the blocks, one after the other, and where each block begins and ends among them ``[blocks + 1]``.
    """
    rows, ends = slice(bounds[0], bounds[-1]), bounds - bounds[0]
    if column.nullable:
        yield np.ascontiguousarray(view.valid(column.name)[rows]), ends
    if column.type == "string":
        yield from _texts(view, column.name, bounds)
    elif column.type.startswith("list"):
        items, lengths = view.items(column.name)
        stops = np.concatenate(([0], np.cumsum(lengths)))[bounds]
        yield lengths[rows].astype("<i4"), ends
        values = _with_one_nan(view, column.name, items[stops[0] : stops[-1]])
        yield values.astype("<f8", copy=False), stops - stops[0]
    else:
        values = _with_one_nan(view, column.name, view[column.name][rows])
        yield values.astype(_TYPES[column.type], copy=False), ends


def _with_one_nan(view: TableView, column: str, values: NDArray[Any]) -> NDArray[Any]:
    """Values of a column, those of floats with one form of NaN, of which there are many."""
    if values.dtype.kind == "f" and np.isnan(view.extremes(column)[0]):
        return np.where(np.isnan(values), values.dtype.type(np.nan), values)
    return values


def _texts(view: TableView, column: str, bounds: Index) -> Iterator[tuple[NDArray[Any], Index]]:
    """Places of texts among the distinct texts of their block, sorted by bytes and -1 for null, and these texts."""
    codes, categories = view.categories(column)
    codes, ends = codes[bounds[0] : bounds[-1]], bounds - bounds[0]
    texts = sorted({text.encode() for text in categories if text is not None})
    width = len(texts) + 1  # null is the first of a block
    number = {text: i for i, text in enumerate(texts, start=1)}
    rank = np.array([0 if text is None else number[text.encode()] for text in categories] + [0])
    runs = _runs(codes, ends)
    cells = (np.searchsorted(ends, runs, side="right") - 1) * width + rank[codes[runs]]
    found, index = _distinct(cells, (len(bounds) - 1) * width)
    members = found[found % width > 0]
    member_ends = np.searchsorted(members, np.arange(len(bounds)) * width)
    places = np.full(len(found), -1, "<i4")
    places[found % width > 0] = np.arange(len(members)) - member_ends[members // width]
    yield np.repeat(places[index], np.diff(runs, append=len(codes))), ends
    yield np.diff(member_ends).astype("<i4"), np.arange(len(bounds))
    framed = [struct.pack("<i", len(text)) + text for text in texts]
    parts = [framed[i] for i in (members % width - 1).tolist()]
    stops = np.concatenate(([0], np.cumsum([len(part) for part in parts], dtype=np.int64)))
    yield np.frombuffer(b"".join(parts), np.uint8), stops[member_ends]


def _runs(codes: NDArray[np.int32], ends: Index) -> Index:
    """First rows of runs of one code within one block."""
    begins = np.ones(len(codes), bool)
    np.not_equal(codes[1:], codes[:-1], out=begins[1:])
    begins[ends[ends < len(codes)]] = True
    return np.flatnonzero(begins)


def _distinct(cells: Index, num_cells: int) -> tuple[Index, Index]:
    """Distinct cells in ascending order, and the place of each cell among them."""
    if num_cells > _CELLS_PER_RUN * len(cells):
        return np.unique(cells, return_inverse=True)
    is_there = np.zeros(num_cells, bool)
    is_there[cells] = True
    return np.flatnonzero(is_there), (np.cumsum(is_there) - 1)[cells]


def sortable(view: TableView, column: str) -> NDArray[Any]:
    """Values in an order that no file decides: texts by their bytes, null before every value."""
    if declared_table(view.name)[column].type != "string":
        return view[column]
    codes, categories = view.categories(column)
    texts = [b"" if text is None else b"\1" + text.encode() for text in (*categories, None)]
    places = {text: place for place, text in enumerate(sorted(set(texts)))}
    return np.array([places[text] for text in texts], np.int64)[codes]


def _order(view: TableView, key: Sequence[NDArray[Any]]) -> Index | None:
    """Order of rows by their key, ``None`` if they have it; rows with one key are in the order of their digests."""
    if not key or _ascends(key):
        return None
    order = np.lexsort([*key][::-1])
    same = np.logical_and.reduce([values[order][1:] == values[order][:-1] for values in key])
    if same.any():
        block = np.concatenate(([0], np.cumsum(~same)))
        tied = np.flatnonzero(np.concatenate(([False], same)) | np.concatenate((same, [False])))
        digests = _digests(TableView(view.name, view.arrow, order[tied]), np.arange(len(tied) + 1))
        ranked = sorted(range(len(tied)), key=lambda i: (block[tied[i]], digests[i]))
        order[tied] = order[tied[ranked]]
    return order


def _ascends(key: Sequence[NDArray[Any]]) -> bool:
    """Whether every row has a greater key than the one before it."""
    tied = np.ones(max(len(key[0]) - 1, 0), bool)
    for values in key:
        before, after = values[:-1], values[1:]
        if (tied & (after < before)).any():
            return False
        tied &= after == before
    return not tied.any()
