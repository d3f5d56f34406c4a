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
from branchdrive.tables.view import StreamView, TableView

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["attempt_digests", "rows_digests", "sortable", "stream_digests", "table_digest"]

Index = NDArray[np.int64]
_TYPES = {"bool": "?", "int32": "<i4", "int64": "<i8", "float32": "<f4", "float64": "<f8"}

_ROWS_AT_ONCE = 1 << 15
"""Rows whose blocks are held at once, but for a block that is larger."""

_CELLS_PER_ROW = 8
"""Blocks times texts, by rows, up to which places of texts are counted in a table of both."""


def table_digest(name: str, table: pa.Table) -> str:
    """SHA-256 of all rows of a table with the declared columns, hexadecimal."""
    view = TableView(name, table)
    columns = declared_table(name).columns
    order = _order(view, [sortable(view, column) for column in declared_table(name).key], columns)
    ordered = view if order is None else TableView(name, table, order)
    (digest,) = _digests(ordered, columns, np.array([0, len(view)]))
    return digest.hex()


def rows_digests(view: TableView) -> list[bytes]:
    """SHA-256 of every row of a table, each a block of its own."""
    return _digests(view, declared_table(view.name).columns, np.arange(len(view) + 1))


def stream_digests(stream: StreamView) -> list[bytes]:
    """SHA-256 of the rows of each rollout in a stream, without the column that names the rollout."""
    declared = declared_table(stream.name)
    columns = declared.columns[1:]  # the first names the rollout
    bounds = np.append(stream.start, len(stream))
    repeats = np.flatnonzero(stream.repeats)
    if len(repeats):
        further = [stream[column] for column in declared.key[2:]]
        if not further or not (further[0][repeats] > further[0][repeats - 1]).all():
            order = _order(stream, [stream.rollout, stream.tick, *further], columns)
            if order is not None:
                return _digests(TableView(stream.name, stream.arrow, order), columns, bounds)
    return _digests(stream, columns, bounds)


def attempt_digests(digests: Sequence[Sequence[bytes]]) -> list[str]:
    """SHA-256 of each attempt, hexadecimal, from the digests of its rows in every table, in declared order."""
    return [hashlib.sha256(b"".join(parts)).hexdigest() for parts in zip(*digests, strict=True)]


def _digests(view: TableView, columns: Sequence[Column], bounds: Index) -> list[bytes]:
    """SHA-256 of blocks of rows, each from its bound to the next."""
    num_blocks = len(bounds) - 1
    at_once = max(1, _ROWS_AT_ONCE * num_blocks // max(1, len(view)))
    parts = [bounds[start : start + at_once + 1] for start in range(0, num_blocks, at_once)]
    return [hashlib.sha256(block.as_buffer()).digest() for part in parts for block in _blocks(view, columns, part)]


def _blocks(view: TableView, columns: Sequence[Column], bounds: Index) -> pa.Array:
    """Bytes of blocks of rows, each from its bound to the next."""
    import pyarrow as pa
    import pyarrow.compute as pc

    heads = [f"{view.name} {num_rows}\n".encode() for num_rows in np.diff(bounds).tolist()]
    pieces = [piece for column in columns for piece in _pieces(view, column, bounds)]
    separator = pa.scalar(b"", pa.large_binary())
    return pc.binary_join_element_wise(pa.array(heads, pa.large_binary()), *pieces, separator)


def _pieces(view: TableView, column: Column, bounds: Index) -> Iterator[pa.Array]:
    """A column by block: where it has values if it may lack them, and the values, zeros where it lacks them."""
    rows = slice(bounds[0], bounds[-1])
    if column.nullable:
        yield _slices(view.valid(column.name)[rows], bounds)
    if column.type == "string":
        yield from _texts(view, column.name, bounds)
    elif column.type.startswith("list"):
        items, lengths = view.items(column.name)
        ends = np.concatenate(([0], np.cumsum(lengths)))[bounds]
        yield _slices(lengths[rows].astype("<i4"), bounds)
        yield _slices(_with_one_nan(view, column.name, items[ends[0] : ends[-1]]).astype("<f8", copy=False), ends)
    else:
        values = _with_one_nan(view, column.name, view[column.name][rows])
        yield _slices(values.astype(_TYPES[column.type], copy=False), bounds)


def _slices(values: NDArray[Any], bounds: Index) -> pa.Array:
    """Bytes of blocks of values, each from its bound to the next, of which the first begins with the first value."""
    import pyarrow as pa

    offsets = pa.py_buffer((bounds - bounds[0]) * values.itemsize)
    return pa.Array.from_buffers(pa.large_binary(), len(bounds) - 1, [None, offsets, pa.py_buffer(values)])


def _with_one_nan(view: TableView, column: str, values: NDArray[Any]) -> NDArray[Any]:
    """Values of a column, those of floats with one form of NaN, of which there are many."""
    if values.dtype.kind == "f" and np.isnan(view.extremes(column)[0]):
        return np.where(np.isnan(values), values.dtype.type(np.nan), values)
    return values


def _texts(view: TableView, column: str, bounds: Index) -> Iterator[pa.Array]:
    """Places of texts among the distinct texts of their block, sorted by bytes and -1 for null, and these texts."""
    codes, categories = view.categories(column)
    texts = sorted({text.encode() for text in categories if text is not None})
    width = len(texts) + 1  # null is the first of a block
    number = {text: i for i, text in enumerate(texts, start=1)}
    rank = np.array([0 if text is None else number[text.encode()] for text in categories] + [0])
    blocks = np.arange(len(bounds))
    cells = np.repeat(blocks[:-1] * width, np.diff(bounds)) + rank[codes[bounds[0] : bounds[-1]]]
    num_cells = (len(bounds) - 1) * width
    if num_cells <= _CELLS_PER_ROW * max(len(cells), 1):
        is_there = np.zeros(num_cells, bool)
        is_there[cells] = True
        found, index = np.flatnonzero(is_there), np.cumsum(is_there) - 1
    else:
        found, cells = np.unique(cells, return_inverse=True)
        index = np.arange(len(found))
    members = found[found % width > 0]
    member_bounds = np.searchsorted(members, blocks * width)
    places = np.full(len(found) + 1, -1, "<i4")  # the last for cells that no row has
    places[:-1][found % width > 0] = np.arange(len(members)) - member_bounds[members // width]
    yield _slices(places[index][cells], bounds)
    yield _slices(np.diff(member_bounds).astype("<i4"), blocks)
    framed = [struct.pack("<i", len(text)) + text for text in texts]
    parts = [framed[i] for i in (members % width - 1).tolist()]
    ends = np.concatenate(([0], np.cumsum([len(part) for part in parts], dtype=np.int64)))
    yield _slices(np.frombuffer(b"".join(parts), np.uint8), ends[member_bounds])


def sortable(view: TableView, column: str) -> NDArray[Any]:
    """Values in an order that no file decides: texts by their bytes, null before every value."""
    if declared_table(view.name)[column].type != "string":
        return view[column]
    codes, categories = view.categories(column)
    texts = [b"" if text is None else b"\1" + text.encode() for text in (*categories, None)]
    places = {text: place for place, text in enumerate(sorted(set(texts)))}
    return np.array([places[text] for text in texts], np.int64)[codes]


def _order(view: TableView, key: Sequence[NDArray[Any]], columns: Sequence[Column]) -> Index | None:
    """Order of rows by their key, ``None`` if they have it; rows with one key are in the order of their digests."""
    order = np.lexsort([*key][::-1])
    same = np.logical_and.reduce([values[order][1:] == values[order][:-1] for values in key])
    if same.any():
        block = np.concatenate(([0], np.cumsum(~same)))
        tied = np.flatnonzero(np.concatenate(([False], same)) | np.concatenate((same, [False])))
        digests = _digests(TableView(view.name, view.arrow, order[tied]), columns, np.arange(len(tied) + 1))
        ranked = sorted(range(len(tied)), key=lambda i: (block[tied[i]], digests[i]))
        order[tied] = order[tied[ranked]]
    return None if (np.diff(order) == 1).all() else order
