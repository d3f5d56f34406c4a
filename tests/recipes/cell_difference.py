"""The operations that change cells of a table, and ranges of rows."""

from __future__ import annotations

import json
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

__all__ = ["cell_operations", "cell_values", "equal_columns", "extend", "joined", "length"]

_MIN_ALIKE = 50
"""Cells from which on a change that all of them share is looked for."""

_MAX_TRIED = 3
"""Rows with the same value, on either side, that a range of rows to copy may start from."""

_MAX_RANGES = 200
"""Ranges of rows to copy, with more of which nothing is shown."""

_MAX_SHIFTS = 4
"""Numbers that the rows of a column may be shifted by, each an operation of its own."""

_MIN_TOLD_CHARACTERS = 60
"""Rows whose numbers take fewer characters are not selected by values."""

_MAX_CONDITIONS = 3
"""Columns by whose values rows are selected."""

_MAX_DISTINCT = 64
"""Values up to which each may be an operation of its own."""


def equal_columns(one: pa.ChunkedArray, other: pa.ChunkedArray) -> bool:
    """Whether columns have the same cells: a zero has its sign, and any NaN is like another."""
    if one.type != other.type or not one.is_null().equals(other.is_null()):
        return False
    if pa.types.is_list(one.type):
        lengths = (pc.list_value_length(column) for column in (one, other))
        return next(lengths).equals(next(lengths)) and equal_columns(pc.list_flatten(one), pc.list_flatten(other))
    if pa.types.is_floating(one.type):
        first, second = (column.drop_null().to_numpy() for column in (one, other))
        is_same = (first == second) & (np.signbit(first) == np.signbit(second))
        return bool((is_same | (np.isnan(first) & np.isnan(second))).all())
    return bool(one.equals(other))


def length(operations: Sequence[Mapping[str, Any]]) -> int:
    """Characters of operations as a case writes them."""
    return len(json.dumps(operations))


def joined(operations: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Operations of which those in a row that give columns one cell each, in the same rows, are one."""
    found: list[dict[str, Any]] = []
    for is_cells, run in groupby(operations, lambda one: one["op"] == "set" and "value" in one):
        if not is_cells:
            found += map(dict, run)
            continue
        alike: dict[str, list[Mapping[str, Any]]] = {}
        for one in run:
            alike.setdefault(json.dumps([one.get("rows"), one.get("where")]), []).append(one)
        for first, *others in alike.values():
            if not others:
                found.append(dict(first))
                continue
            which = {name: first[name] for name in ("op", "rows", "where") if name in first}
            found.append({**which, "cells": {one["column"]: one["value"] for one in (first, *others)}})
    return found


def _ranges(rows: Sequence[int]) -> list[list[int]]:
    found: list[list[Any]] = []
    for row in rows:
        extend(found, row, [])
    return found


def extend(ranges: list[list[Any]], row: int, file: Sequence[str | None]) -> None:
    """Add a row to ranges: to the last one, if it goes on there in its direction."""
    if ranges and ranges[-1][2:] == [*file]:
        start, stop = ranges[-1][:2]
        step = 1 if stop > start else -1
        if row == stop and (step > 0 or row >= 0):
            ranges[-1][1] += step
            return
        if stop - start == 1 and row == start - 1:
            ranges[-1][1] = row - 1
            return
    ranges.append([row, row + 1, *file])


def cell_operations(table: pa.Table, after: pa.Table) -> Iterator[dict[str, Any]]:
    """Operations that give the cells of one table those of another one with the same columns and rows."""
    columns = _Columns(table)
    places = _Places(table, [name for name in table.column_names if equal_columns(table[name], after[name])])
    for name in table.column_names:
        old, new = table[name], after[name]
        if equal_columns(old, new):
            continue
        kind, cells = new.type, new.to_pylist()
        texts = list(map(repr, cells))
        rows = [i for i, (one, other) in enumerate(zip(columns.texts(name), texts, strict=True)) if one != other]
        start: dict[str, Any] = {"column": name, **places.of(rows)}
        shared = _shared_changes(old, new, rows)
        if shared:
            yield from ({"op": op, "column": name, **places.of(mine), "by": by} for op, by, mine in shared)
            columns.change(name, texts)
            continue
        ways: list[list[dict[str, Any]]] = [[{**start, "op": "set", **cell_values([cells[i] for i in rows], kind)}]]
        by_value: dict[str, list[int]] = {}
        for row in rows:
            by_value.setdefault(texts[row], []).append(row)
        if 1 < len(by_value) <= _MAX_DISTINCT:
            ways.append([
                {"op": "set", "column": name, **places.of(mine), **cell_values([cells[mine[0]]], kind)}
                for mine in by_value.values()
            ])  # fmt: skip
        if len(rows) > 1:
            for other in sorted(table.column_names, key=lambda other: other != name):
                if table.schema.field(other).type != kind:
                    continue
                of = {} if other == name else {"of": other}
                beside = columns.beside(other, rows, texts)
                found = columns.taken(other, rows, [texts[i] for i in rows]) if beside is None else None
                if beside is not None:
                    ways.append([{"op": "set", "column": name, **places.of(beside), **of}])
                elif found is not None:
                    ways.append([{**start, "op": "set", "from": found, **of}])
        yield from min(ways, key=length)
        columns.change(name, texts)


class _Places:
    """Says which rows are meant: by values of columns that do not change, or by their numbers, whichever is shorter."""

    def __init__(self, table: pa.Table, names: Sequence[str]) -> None:
        self._table, self._names = table, names
        self._cells: dict[str, np.ndarray] = {}

    def of(self, rows: Sequence[int]) -> dict[str, Any]:
        """The member `where` or `rows` of an operation."""
        ways = [{"rows": _ranges(rows)}]
        if length(ways) > _MIN_TOLD_CHARACTERS and (wanted := self._wanted(np.asarray(rows))):
            ways.append({"where": wanted})
        return min(ways, key=lambda way: length([way]))

    def _wanted(self, rows: np.ndarray) -> dict[str, Any] | None:
        """Values that columns have in these rows and in no others; ``None`` where few columns do not tell them."""
        mask, wanted = np.ones(len(self._table), bool), dict[str, Any]()
        while mask.sum() > len(rows) and len(wanted) < _MAX_CONDITIONS:
            conditions = [
                (name, *way) for name in self._names if name not in wanted for way in self._conditions(name, rows)
            ]
            if not conditions:
                return None
            name, value, found = min(conditions, key=lambda one: ((mask & one[2]).sum(), len(json.dumps(one[1]))))
            if not (mask & ~found).any():
                return None
            wanted[name], mask = value, mask & found
        return wanted if mask.sum() == len(rows) else None

    def _conditions(self, name: str, rows: np.ndarray) -> Iterator[tuple[Any, np.ndarray]]:
        """Conditions on a column that hold in the rows, each with where it holds."""
        kind = self._table.schema.field(name).type
        if self._table[name].null_count or not (pa.types.is_string(kind) or pa.types.is_integer(kind)):
            return
        if name not in self._cells:
            self._cells[name] = self._table[name].to_numpy()
        cells = self._cells[name]
        values = sorted(set(cells[rows].tolist()))
        yield (values[0] if len(values) == 1 else values), np.isin(cells, values)
        if len(values) > 1 and pa.types.is_integer(kind):
            yield {"from": values[0], "to": values[-1]}, (values[0] <= cells) & (cells <= values[-1])


class _Columns:
    """Cells of a table as text, by column; columns change as operations go on."""

    def __init__(self, table: pa.Table) -> None:
        self._table = table
        self._texts: dict[str, list[str]] = {}
        self._places: dict[str, dict[str, list[int]]] = {}

    def texts(self, name: str) -> list[str]:
        """Texts of a column's cells."""
        if name not in self._texts:
            self._texts[name] = list(map(repr, self._table[name].to_pylist()))
        return self._texts[name]

    def change(self, name: str, texts: list[str]) -> None:
        """Give a column other cells."""
        self._texts[name] = texts
        self._places.pop(name, None)

    def _rows(self, name: str) -> dict[str, list[int]]:
        if name not in self._places:
            places: dict[str, list[int]] = {}
            for row, text in enumerate(self.texts(name)):
                places.setdefault(text, []).append(row)
            self._places[name] = places
        return self._places[name]

    def beside(self, name: str, rows: Sequence[int], wanted: Sequence[str]) -> list[int] | None:
        """Rows in which a column's cells are the wanted ones, in ranges that hold `rows`; ``None`` if not all are."""
        if wanted[rows[0]] != self.texts(name)[rows[0]]:
            return None
        alike = [row for row, (one, other) in enumerate(zip(self.texts(name), wanted, strict=True)) if one == other]
        if not set(rows) <= set(alike):
            return None
        taken = [span for span in _ranges(alike) if bisect_left(rows, span[1]) > bisect_left(rows, span[0])]
        return [row for start, stop in taken for row in range(start, stop)]

    def taken(self, name: str, rows: Sequence[int], wanted: Sequence[str]) -> list[list[int]] | None:
        """Ranges of a column's cells that are the wanted ones; at each place the longest, ``None`` where none are."""
        texts = self.texts(name)
        if not {wanted[0], wanted[len(wanted) // 2], wanted[-1]} <= set(texts):
            return None
        places = self._rows(name)
        if any(text not in places for text in wanted):
            return None
        found: list[list[int]] = []
        done = 0
        while done < len(wanted):
            at = places[wanted[done]]
            near = bisect_left(at, rows[done])
            best, most = -1, 0
            for row in at[max(near - _MAX_TRIED, 0) : near + _MAX_TRIED]:
                run = 0
                while done + run < len(wanted) and row + run < len(texts) and texts[row + run] == wanted[done + run]:
                    run += 1
                if run > most:
                    best, most = row, run
            found.append([best, best + most])
            done += most
            if len(found) > _MAX_RANGES:
                return None
        return found


def _shared_changes(
    before: pa.ChunkedArray, after: pa.ChunkedArray, rows: Sequence[int]
) -> list[tuple[str, float, list[int]]]:
    """Operation, number and rows where values were multiplied by one number, or one of few was added; else nothing."""
    kind = after.type
    is_number = pa.types.is_floating(kind) or pa.types.is_integer(kind)
    if len(rows) < _MIN_ALIKE or not is_number:
        return []
    cells = [column.take(pa.array(rows)) for column in (before, after)]
    if any(column.null_count for column in cells):
        return []
    old, new = (column.to_numpy().astype(np.float64) for column in cells)
    largest = int(np.argmax(np.abs(old)))
    if not old[largest] or not np.isfinite(new).all():
        return []
    dtype = kind.to_pandas_dtype()
    ratio, difference = new[largest] / old[largest], new[largest] - old[largest]
    for name, change, number in (
        ("scale", np.multiply, ratio), ("scale", np.multiply, round(ratio, 6)),
        ("shift", np.add, difference), ("shift", np.add, round(difference, 6)),
    ):  # fmt: skip
        if number and np.array_equal(change(old, number).astype(dtype), new.astype(dtype)):
            return [(name, float(number), list(rows))]
    differences, owners = np.unique(new - old, return_inverse=True)
    is_shifted = np.array_equal((old + differences[owners]).astype(dtype), new.astype(dtype))
    if len(differences) > _MAX_SHIFTS or not is_shifted:  # of few numbers: angles are wrapped
        return []
    return [
        ("shift", float(number), np.asarray(rows)[owners == place].tolist()) for place, number in enumerate(differences)
    ]


def cell_values(cells: list[Any], kind: pa.DataType) -> dict[str, Any]:
    """Cells as a recipe writes them: one value for all, or one for each."""
    written = [_to_cell(cell, kind) for cell in cells]
    if len({*map(repr, written)}) == 1:
        return {"value": written[0]}
    return {"values": written}


def _to_cell(value: Any, kind: pa.DataType) -> Any:
    """A cell as a recipe writes it; the shortest number that the column's type tells apart."""
    if isinstance(value, list):
        return [_to_cell(item, kind.value_type) for item in value]
    if isinstance(value, bytes):
        return value.hex()
    if pa.types.is_floating(kind) and value is not None:
        if not np.isfinite(value):
            return "NaN" if np.isnan(value) else "Infinity" if value > 0 else "-Infinity"
        return float(str(np.float32(value))) if pa.types.is_float32(kind) else value
    return value
