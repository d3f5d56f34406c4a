"""Digests of what tables say: blocks of rows in the order of their key, column by column, whoever wrote the file.

Source: spec/03-layout.md#content.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import Column, declared_table
from branchdrive.tables.view import StreamView, TableView

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["attempt_digests", "rows_digests", "stream_digests", "table_digest"]

Index = NDArray[np.int64]
Pieces = Sequence[bytes]
"""Bytes of one column in every block."""

_TYPES = {"bool": "?", "int32": "<i4", "int64": "<i8", "float32": "<f4", "float64": "<f8"}
_ONE = struct.pack("<i", 1)
_PIECE_ROWS = 1 << 20

_CELLS_PER_ROW = 8
"""Blocks times texts, by rows, up to which places of texts are counted in a table of both."""


def table_digest(name: str, table: pa.Table) -> str:
    """SHA-256 of all rows of a table with the declared columns, hexadecimal."""
    view = TableView(name, table)
    columns = declared_table(name).columns
    order = _order(view, [_sortable(view, column) for column in declared_table(name).key], columns)
    ordered = view if order is None else TableView(name, table, order)
    (digest,) = _digests(ordered, columns, np.zeros(1, np.int64), np.array([len(view)]))
    return digest.hex()


def rows_digests(view: TableView) -> list[bytes]:
    """SHA-256 of every row of a table, each a block of its own."""
    starts = np.arange(len(view))
    return _digests(view, declared_table(view.name).columns, starts, starts + 1)


def stream_digests(stream: StreamView) -> list[bytes]:
    """SHA-256 of the rows of each rollout in a stream, without the column that names the rollout."""
    declared = declared_table(stream.name)
    columns = declared.columns[1:]  # the first names the rollout
    repeats = np.flatnonzero(stream.repeats)
    if len(repeats):
        further = [stream[column] for column in declared.key[2:]]
        if not further or not (further[0][repeats] > further[0][repeats - 1]).all():
            order = _order(stream, [stream.rollout, stream.tick, *further], columns)
            if order is not None:
                ordered = TableView(stream.name, stream.arrow, order)
                return _digests(ordered, columns, stream.start, stream.stop)
    return _digests(stream, columns, stream.start, stream.stop)


def attempt_digests(digests: Sequence[Sequence[bytes]]) -> list[str]:
    """SHA-256 of each attempt, hexadecimal, from the digests of its rows in every table, in declared order."""
    return [hashlib.sha256(b"".join(parts)).hexdigest() for parts in zip(*digests, strict=True)]


def _digests(view: TableView, columns: Sequence[Column], starts: Index, stops: Index) -> list[bytes]:
    """SHA-256 of blocks of rows, one after the other."""
    heads = [f"{view.name} {num_rows}\n".encode() for num_rows in (stops - starts).tolist()]
    pieces = [piece for column in columns for piece in _pieces(view, column, starts, stops)]
    return [hashlib.sha256(b"".join(block)).digest() for block in zip(heads, *pieces, strict=True)]


def _pieces(view: TableView, column: Column, starts: Index, stops: Index) -> Iterator[Pieces]:
    """A column by block: where it has values if it may lack them, and the values, zeros where it lacks them."""
    if column.nullable:
        yield _slices(view.valid(column.name).tobytes(), 1, starts, stops)
    if column.type == "string":
        yield from _texts(view, column.name, starts, stops)
    elif column.type.startswith("list"):
        items, lengths = view.items(column.name)
        ends = np.concatenate(([0], np.cumsum(lengths)))
        yield _slices(lengths.astype("<i4").tobytes(), 4, starts, stops)
        yield _slices(_bytes(items, "<f8"), 8, ends[starts], ends[stops])
    else:
        kind = np.dtype(_TYPES[column.type])
        content = b"".join([_bytes(values, kind) for _, (values,) in view.pieces([column.name], _PIECE_ROWS)])
        yield _slices(content, kind.itemsize, starts, stops)


def _slices(content: bytes, width: int, starts: Index, stops: Index) -> Pieces:
    places = zip((starts * width).tolist(), (stops * width).tolist(), strict=True)
    return [content[start:stop] for start, stop in places]


def _bytes(values: NDArray[Any], kind: np.dtype[Any] | str) -> bytes:
    """Bytes of values, those of floats with one form of NaN, of which there are many."""
    if values.dtype.kind == "f" and (unknown := np.isnan(values)).any():
        values = np.where(unknown, values.dtype.type(np.nan), values)
    return values.astype(kind, copy=False).tobytes()


def _texts(view: TableView, column: str, starts: Index, stops: Index) -> Iterator[Pieces]:
    """Places of texts among the distinct texts of their block, sorted by bytes and -1 for null, and these texts."""
    codes, categories = view.categories(column)
    texts = sorted({text.encode() for text in categories if text is not None})
    width = len(texts) + 1  # null is the first of a block
    number = {text: i for i, text in enumerate(texts, start=1)}
    rank = np.array([0 if text is None else number[text.encode()] for text in categories] + [0])[codes]
    first, last = (int(starts[0]), int(stops[-1])) if len(starts) else (0, 0)
    cells = np.repeat(np.arange(len(starts)) * width, stops - starts) + rank[first:last]
    if len(starts) * width <= _CELLS_PER_ROW * max(last - first, 1):
        is_there = np.zeros(len(starts) * width, bool)
        is_there[cells] = True
        found, inverse = np.flatnonzero(is_there), cells
    else:
        found, inverse = np.unique(cells, return_inverse=True)
    members = found[found % width > 0]
    bounds = np.searchsorted(members, np.arange(len(starts) + 1) * width)
    places = np.full(len(found), -1, "<i4")
    places[found % width > 0] = np.arange(len(members)) - bounds[members // width]
    if inverse is cells:
        places_of_cells = np.full(len(starts) * width, -1, "<i4")
        places_of_cells[found] = places
        places = places_of_cells
    yield _slices(places[inverse].tobytes(), 4, starts - first, stops - first)
    framed = [struct.pack("<i", len(text)) + text for text in texts]
    alone = [_ONE + text for text in framed]
    ranks, ends = (members % width - 1).tolist(), bounds.tolist()
    yield [
        alone[ranks[start]]
        if stop - start == 1
        else b"".join([struct.pack("<i", stop - start), *[framed[i] for i in ranks[start:stop]]])
        for start, stop in pairwise(ends)
    ]


def _sortable(view: TableView, column: str) -> NDArray[Any]:
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
        each = np.arange(len(tied))
        digests = _digests(TableView(view.name, view.arrow, order[tied]), columns, each, each + 1)
        ranked = sorted(range(len(tied)), key=lambda i: (block[tied[i]], digests[i]))
        order[tied] = order[tied[ranked]]
    return None if (np.diff(order) == 1).all() else order
