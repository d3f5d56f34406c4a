"""The operations that lead from one table to another: the inverse of `table_operation.apply_to_table`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from tests.recipes.cell_difference import cell_operations, cell_values, equal_columns, extend, joined, length

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

_MAX_OWN_BYTES = 1_000
"""Operations up to this size are not compared with those that take rows of other tables."""


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
    return all(equal_columns(one.column(i), other.column(i)) for i in range(len(one.schema)))


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
        is_other = found is None or length(found) > _MAX_OWN_BYTES or (len(found) > 1 and found[0]["op"] == "rows")
        if is_other:
            others = {name: table for name, table in alike.of(new).items() if name != path}
            pooled = _cheapest(path, before, after, others) if others else None
            found = min((one for one in (found, pooled) if one is not None), key=length, default=None)
    except (ValueError, OSError, pa.ArrowException):
        return None
    if found is None:
        return None
    if settings is not None:
        found.append({"op": "written", "settings": settings})
    return [{"op": operation.pop("op"), "file": path, **operation} for operation in joined(found)]


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
    candidates = [] if others else _sorted(before, after)
    for keep in _sources(path, before, after, others):
        operations: list[dict[str, Any]] = []
        table = before
        if keep != _whole(before):
            operations.append({"op": "rows", "keep": keep})
            table = apply_to_table(operations[-1], table, others.__getitem__)
        for step in (_column_operations, _schema_operations, cell_operations, _null_operations):
            for operation in step(table, after):
                operations.append(operation)
                table = apply_to_table(operation, table, others.__getitem__)
        if equal_tables(table, after):
            candidates.append(operations)
    return min(candidates, key=length, default=None)


def _sorted(before: pa.Table, after: pa.Table) -> list[list[dict[str, Any]]]:
    """The order of one column that makes one table of the other."""
    if len(before) != len(after) or before.schema != after.schema:
        return []
    keys = [name for name in before.column_names if not pa.types.is_list(before.schema.field(name).type)]
    ways = [[{"op": "sort", "by": [name]}] for name in keys if not equal_columns(before[name], after[name])]
    return [way for way in ways if equal_tables(apply_to_table(way[0], before, {}.__getitem__), after)]


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
            extend(found, own, file)
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


def _column_operations(table: pa.Table, after: pa.Table) -> Iterator[dict[str, Any]]:
    for name in table.column_names:
        if name not in after.column_names:
            yield {"op": "drop_column", "column": name}
        elif (kind := after.schema.field(name).type) != table.schema.field(name).type:
            yield {"op": "cast", "column": name, "type": _alias(kind)}
    for name in after.column_names:
        if name not in table.column_names:
            kind = after.schema.field(name).type
            yield {
                "op": "add_column",
                "column": name,
                "type": _alias(kind),
                **cell_values(after[name].to_pylist(), kind),
            }


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
