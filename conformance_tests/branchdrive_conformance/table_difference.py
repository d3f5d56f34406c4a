"""The operations that lead from one table to another: the inverse of `table_operation.apply_to_table`."""

from __future__ import annotations

import json
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from branchdrive.contract.columns import LAYER_TABLES, TABLES
from branchdrive_conformance.table_operation import DICTIONARY, apply_to_table, encoded, read_table

__all__ = ["TablesAlike", "equal_tables", "table_operations"]

_SETTINGS: tuple[dict[str, Any] | None, ...] = (
    None,
    {"compression": "snappy"},
    {"store_schema": False},
    {"compression": "gzip", "row_group_size": 97, "write_statistics": False, "data_page_version": "2.0"},
)
"""Ways in which files of cases are written; the first is that of all of the project's tables."""

_MIN_ALIKE = 50
"""Cells from which on a change that all of them share is looked for."""

_MAX_OWN_BYTES = 1_000
"""Operations up to this size are not compared with those that take rows of other tables."""

_MAX_TRIED = 3
"""Rows with the same value, on either side, that a range of rows to copy may start from."""

_MAX_RANGES = 200
"""Ranges of rows to copy, with more of which nothing is shown."""

_MAX_DISTINCT = 64
"""Values up to which each may be an operation of its own."""


class TablesAlike:
    """Tables of a base dataset by the columns that they have."""

    def __init__(self, base: Path, paths: Sequence[str]) -> None:
        self._base, self._paths = base, paths

    def of(self, content: bytes) -> dict[str, pa.Table]:
        """Tables with the columns and types of the one in `content`, by file."""
        try:
            schema = read_table(content).schema
        except (OSError, ValueError, pa.ArrowException):
            return {}
        return {
            path: table
            for path in self._paths
            if (table := _read(self._base / path)) is not None and _form(table.schema) == _form(schema)
        }

    def table(self, path: str) -> pa.Table:
        """One of them."""
        return read_table((self._base / path).read_bytes())


def _read(path: Path) -> pa.Table | None:
    try:
        return read_table(path.read_bytes())
    except (OSError, ValueError, pa.ArrowException):
        return None


def _form(schema: pa.Schema) -> list[tuple[str, str]]:
    return [(field.name, str(field.type)) for field in schema]


def equal_tables(one: pa.Table, other: pa.Table) -> bool:
    """Whether tables have the same columns, types, metadata and cells, whatever is said of nulls."""
    if [(f.name, f.type, f.metadata or None) for f in one.schema] != [
        (f.name, f.type, f.metadata or None) for f in other.schema
    ]:
        return False
    if (one.schema.metadata or None) != (other.schema.metadata or None) or len(one) != len(other):
        return False
    return all(_equal(one.column(i), other.column(i)) for i in range(len(one.schema)))


def _equal(one: pa.ChunkedArray, other: pa.ChunkedArray) -> bool:
    if one.equals(other):
        return True
    if pa.types.is_floating(one.type) and one.is_null() == other.is_null():
        first, second = (column.to_numpy(zero_copy_only=False) for column in (one, other))
        return bool(np.array_equal(first, second, equal_nan=True))
    return repr(one.to_pylist()) == repr(other.to_pylist()) if not pa.types.is_floating(one.type) else False


def table_operations(path: str, old: bytes, new: bytes, alike: TablesAlike) -> list[dict[str, Any]] | None:
    """The shortest operations on the table in a file that make another one of it; ``None`` where none do.

    Args:
        path: The file, relative to the dataset.
        old: Its bytes in the base.
        new: Its bytes in the changed dataset.
        alike: Tables whose rows may be taken.
    """
    try:
        before, after = read_table(old), read_table(new)
        settings = next((one for one in _SETTINGS if encoded(after, one) == new), ...)
        if settings is ...:  # the way in which it is written is the case
            return None
        found = _cheapest(path, before, after, {})
        is_other = found is None or _length(found) > _MAX_OWN_BYTES or (len(found) > 1 and found[0]["op"] == "rows")
        if is_other:
            others = {name: table for name, table in alike.of(new).items() if name != path}
            pooled = _cheapest(path, before, after, others) if others else None
            found = min((one for one in (found, pooled) if one is not None), key=_length, default=None)
    except (ValueError, OSError, pa.ArrowException):
        return None
    if found is None:
        return None
    if settings is not None:
        found.append({"op": "written", "settings": settings})
    return [{"op": operation.pop("op"), "file": path, **operation} for operation in found]


def _length(operations: Sequence[Mapping[str, Any]]) -> int:
    return len(json.dumps(operations))


def _cheapest(
    path: str, before: pa.Table, after: pa.Table, others: Mapping[str, pa.Table]
) -> list[dict[str, Any]] | None:
    """The shortest operations that make one table of the other; ``None`` where none do.

    Args:
        path: The file.
        before: Its table in the base.
        after: Its table in the changed dataset.
        others: Tables whose rows are taken too, by file; without any, rows are those of the table itself.
    """
    candidates = []
    for keep in _sources(path, before, after, others):
        operations: list[dict[str, Any]] = []
        table = before
        if keep != _whole(before):
            operations.append({"op": "rows", "keep": keep})
            table = apply_to_table(operations[-1], table, others.__getitem__)
        for step in (_column_operations, _schema_operations, _cell_operations, _null_operations):
            for operation in step(table, after):
                operations.append(operation)
                table = apply_to_table(operation, table, others.__getitem__)
        if equal_tables(table, after):
            candidates.append(operations)
    return min(candidates, key=_length, default=None)


def _sources(path: str, before: pa.Table, after: pa.Table, others: Mapping[str, pa.Table]) -> Iterator[list[list[Any]]]:
    """Ways to see rows of the new table as ranges of rows of old ones."""
    if len(before) == len(after) and not others:
        yield _whole(before)
    name = Path(path).stem.partition("-")[0]
    declared = TABLES.get(name) or LAYER_TABLES.get(name)
    key = [column for column in (declared.key if declared else ()) if column in before.column_names]
    pool = pa.concat_tables([before, *(table.cast(before.schema) for table in others.values())])
    if len(pool) and key and set(key) <= set(after.column_names):
        rows = _by_key(pool, after, key)
        starts = np.cumsum([0, len(before), *map(len, others.values())])
        owners = np.searchsorted(starts, rows, side="right") - 1
        names = [None, *others]
        found: list[list[Any]] = []
        for row, owner in zip(rows, owners.tolist(), strict=True):
            own, file = int(row - starts[owner]), names[owner : owner + 1] if owner else []
            _extend(found, own, file)
        yield found


def _whole(table: pa.Table) -> list[list[Any]]:
    return [[0, len(table)]] if len(table) else []


def _by_key(before: pa.Table, after: pa.Table, key: list[str]) -> list[int]:
    """Rows of a table that are most like those of another one: with its key, else with its content, else the next."""
    others = [name for name in before.column_names if name not in key[:1] and name in after.column_names]
    keys, contents = _tuples(before, key), _tuples(before, others)
    free: dict[Any, list[int]] = {}
    for row in reversed(range(len(before))):
        free.setdefault(keys[row], []).append(row)
    alike = {content: row for row, content in reversed(list(enumerate(contents)))}
    taken: dict[Any, int] = {}
    source, previous = [], -1
    for own, content in zip(_tuples(after, key), _tuples(after, others), strict=True):
        if free.get(own):
            previous = taken[own] = free[own].pop()
        elif content in alike:
            previous = alike[content]
        else:
            previous = taken.get(own, min(previous + 1, len(before) - 1))
        source.append(previous)
    return source


def _tuples(table: pa.Table, columns: list[str]) -> list[Any]:
    return list(map(repr, zip(*(table[name].to_pylist() for name in columns), strict=True)))


def _ranges(rows: Sequence[int]) -> list[list[int]]:
    found: list[list[Any]] = []
    for row in rows:
        _extend(found, row, [])
    return found


def _extend(ranges: list[list[Any]], row: int, file: Sequence[str | None]) -> None:
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


def _column_operations(table: pa.Table, after: pa.Table) -> Iterator[dict[str, Any]]:
    for name in table.column_names:
        if name not in after.column_names:
            yield {"op": "drop_column", "column": name}
        elif (kind := after.schema.field(name).type) != table.schema.field(name).type:
            yield {"op": "cast", "column": name, "type": _alias(kind)}
    for name in after.column_names:
        if name not in table.column_names:
            kind = after.schema.field(name).type
            yield {"op": "add_column", "column": name, "type": _alias(kind), **_values(after[name].to_pylist(), kind)}


def _schema_operations(table: pa.Table, after: pa.Table) -> Iterator[dict[str, Any]]:
    if table.column_names != after.column_names:
        yield {"op": "order", "columns": after.column_names}
    before = {name: table.schema.field(name).metadata or None for name in after.column_names}
    changed = {
        name: _texts(metadata)
        for name, old in before.items()
        if (metadata := after.schema.field(name).metadata or None) != old
    }
    is_bare = len(changed) > 1 and not any(after.schema.field(name).metadata for name in after.column_names)
    own = after.schema.metadata or None
    if changed or own != (table.schema.metadata or None):
        about = {} if own == (table.schema.metadata or None) else {"table": _texts(own)}
        yield {"op": "describe", **about, "columns": None if is_bare else changed}


def _texts(metadata: dict[bytes, bytes] | None) -> dict[str, str] | None:
    return None if metadata is None else {key.decode(): value.decode() for key, value in metadata.items()}


def _alias(kind: pa.DataType) -> str:
    if kind == DICTIONARY:
        return "dictionary"
    if pa.type_for_alias(str(kind)) != kind:
        raise ValueError(f"{kind} has no alias")
    return str(kind)


def _null_operations(table: pa.Table, after: pa.Table) -> Iterator[dict[str, Any]]:
    columns = [field.name for field in after.schema if field.nullable and not table.schema.field(field.name).nullable]
    if columns:
        yield {"op": "nullable", "columns": columns}


def _cell_operations(table: pa.Table, after: pa.Table) -> Iterator[dict[str, Any]]:
    columns = _Columns(table)
    for name in table.column_names:
        old, new = table[name], after[name]
        if _equal(old, new):
            continue
        kind, cells = new.type, new.to_pylist()
        texts = list(map(repr, cells))
        rows = [i for i, (one, other) in enumerate(zip(columns.texts(name), texts, strict=True)) if one != other]
        start: dict[str, Any] = {"column": name, "rows": _ranges(rows)}
        shared = _shared_change(old, new, rows)
        if shared is not None:
            yield {**start, **shared}
            columns.change(name, texts)
            continue
        ways: list[list[dict[str, Any]]] = [[{**start, "op": "set", **_values([cells[i] for i in rows], kind)}]]
        by_value: dict[str, list[int]] = {}
        for row in rows:
            by_value.setdefault(texts[row], []).append(row)
        if 1 < len(by_value) <= _MAX_DISTINCT:
            ways.append([
                {"op": "set", "column": name, "rows": _ranges(mine), **_values([cells[mine[0]]], kind)}
                for mine in by_value.values()
            ])  # fmt: skip
        if len(rows) > 1:
            for other in sorted(table.column_names, key=lambda other: other != name):
                is_alike = table.schema.field(other).type == kind
                found = columns.taken(other, rows, [texts[i] for i in rows]) if is_alike else None
                if found is not None:
                    ways.append([{**start, "op": "set", "from": found, **({} if other == name else {"of": other})}])
        yield from min(ways, key=_length)
        columns.change(name, texts)


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
            best, length = -1, 0
            for row in at[max(near - _MAX_TRIED, 0) : near + _MAX_TRIED]:
                run = 0
                while done + run < len(wanted) and row + run < len(texts) and texts[row + run] == wanted[done + run]:
                    run += 1
                if run > length:
                    best, length = row, run
            found.append([best, best + length])
            done += length
            if len(found) > _MAX_RANGES:
                return None
        return found


def _shared_change(before: pa.ChunkedArray, after: pa.ChunkedArray, rows: Sequence[int]) -> dict[str, Any] | None:
    """The number that all values in some rows were multiplied by, or that was added to them."""
    kind = after.type
    is_number = pa.types.is_floating(kind) or pa.types.is_integer(kind)
    if len(rows) < _MIN_ALIKE or not is_number:
        return None
    cells = [column.take(pa.array(rows)) for column in (before, after)]
    if any(column.null_count for column in cells):
        return None
    old, new = (column.to_numpy().astype(np.float64) for column in cells)
    largest = int(np.argmax(np.abs(old)))
    if not old[largest] or not np.isfinite(new).all():
        return None
    dtype = kind.to_pandas_dtype()
    ratio, difference = new[largest] / old[largest], new[largest] - old[largest]
    for name, change, number in (
        ("scale", np.multiply, ratio), ("scale", np.multiply, round(ratio, 6)),
        ("shift", np.add, difference), ("shift", np.add, round(difference, 6)),
    ):  # fmt: skip
        if number and np.array_equal(change(old, number).astype(dtype), new.astype(dtype)):
            return {"op": name, "by": float(number)}
    return None


def _values(cells: list[Any], kind: pa.DataType) -> dict[str, Any]:
    written = [_to_cell(cell, kind) for cell in cells]
    if written and all(cell == written[0] for cell in written):
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
