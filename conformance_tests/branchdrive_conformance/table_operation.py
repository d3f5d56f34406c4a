"""Operations of recipes on tables: rows, cells, columns, and the way in which the file is written.

What each is called and takes is described in `recipe`.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from branchdrive.formats.parquet import encode_table

__all__ = ["DICTIONARY", "TABLE_OPERATIONS", "TableOf", "apply_to_table", "encoded", "from_cell", "read_table"]

Operation = Mapping[str, Any]
TableOf = Callable[[str], pa.Table]
"""The table in a file of the dataset as the base has it."""

TABLE_OPERATIONS = (
    "rows", "sort", "set", "scale", "shift", "drop_column", "add_column", "cast", "order", "nullable", "describe",
    "written",
)  # fmt: skip

DICTIONARY = pa.dictionary(pa.int32(), pa.string())
"""Text in a dictionary, `dictionary` in a recipe."""

_NUMBERS = {"NaN": float("nan"), "Infinity": float("inf"), "-Infinity": float("-inf")}


def read_table(content: bytes) -> pa.Table:
    """Table of a Parquet file of a base dataset, types as they are stored, names of items of lists included.

    Raises:
        pyarrow.ArrowException: The bytes are no Parquet file.
    """
    file = pq.ParquetFile(pa.BufferReader(content))
    table = file.read()
    written = (file.metadata.metadata or {}).get(b"ARROW:schema")
    if written is None:
        return table
    schema = pa.ipc.read_schema(pa.BufferReader(base64.b64decode(written)))
    kinds = [
        other.type if pa.types.is_list(field.type) and pa.types.is_list(other.type) else field.type
        for field, other in zip(table.schema, schema, strict=True)
    ]
    return table.cast(
        pa.schema(
            [field.with_type(kind) for field, kind in zip(table.schema, kinds, strict=True)], table.schema.metadata
        )
    )


def encoded(table: pa.Table, settings: Mapping[str, Any] | None = None) -> bytes:
    """Parquet bytes of a table, written as all of the project's are, or with settings of pyarrow's `write_table`."""
    if settings is None:
        return encode_table(table)
    sink = pa.BufferOutputStream()
    pairs = table.schema.metadata if settings.get("store_schema") is False else None
    with pq.ParquetWriter(sink, table.schema, **{k: v for k, v in settings.items() if k != "row_group_size"}) as writer:
        writer.write_table(table, settings.get("row_group_size"))
        if pairs:  # which the writer keeps in the Arrow schema alone
            writer.add_key_value_metadata(pairs)
    return bytes(sink.getvalue())


def _rows_of(ranges: Iterable[Sequence[Any]], table: pa.Table, table_of: TableOf) -> pa.Table:
    """Rows of ranges ``[start, stop]``, or ``[start, stop, file]`` of other tables."""
    parts = []
    for start, stop, *file in ranges:
        source = table_of(file[0]).cast(table.schema) if file else table
        parts.append(source.take(pa.array(_places([[start, stop]], len(source)))))
    return pa.concat_tables(parts).combine_chunks() if parts else table.slice(0, 0)


def _places(ranges: Iterable[Sequence[int]], num_rows: int) -> np.ndarray:
    """Row numbers of ranges.

    Raises:
        ValueError: A range is not within the table.
    """
    parts = [np.zeros(0, np.int64)]
    for start, stop in ranges:
        first, last = (start, stop - 1) if start < stop else (stop + 1, start)
        if start == stop or not 0 <= first <= last < num_rows:
            raise ValueError(f"rows {start} to {stop} are not within {num_rows}")
        parts.append(np.arange(start, stop, 1 if start < stop else -1))
    return np.concatenate(parts)


def _where(wanted: Mapping[str, Any], table: pa.Table) -> np.ndarray:
    """Row numbers of the rows whose cells have the wanted values: one, one of a list, or one of a range.

    Raises:
        ValueError: No row has them.
    """
    mask = np.ones(len(table), bool)
    for name, value in wanted.items():
        column = table.column(name).combine_chunks()
        if isinstance(value, Mapping):
            found = pc.and_(pc.greater_equal(column, value["from"]), pc.less_equal(column, value["to"]))
        else:
            found = pc.is_in(column, pa.array(value if isinstance(value, list) else [value], column.type))
        mask &= found.fill_null(False).to_numpy(zero_copy_only=False)
    if not mask.any():
        raise ValueError(f"no row has {dict(wanted)}")
    return np.flatnonzero(mask)


def from_cell(value: Any, kind: pa.DataType) -> Any:
    """A value of a recipe as a cell of a column."""
    if isinstance(value, list) and pa.types.is_list(kind):
        return [from_cell(item, kind.value_type) for item in value]
    if isinstance(value, str) and (pa.types.is_binary(kind) or pa.types.is_fixed_size_binary(kind)):
        return bytes.fromhex(value)
    return _NUMBERS[value] if pa.types.is_floating(kind) and isinstance(value, str) else value


def _cells(operation: Operation, kind: pa.DataType, count: int) -> pa.Array:
    values = operation["values"] if "values" in operation else [operation["value"]] * count
    if len(values) != count:
        raise ValueError(f"{operation['op']} of {operation['column']}: {len(values)} values for {count} rows")
    return pa.array([from_cell(value, kind) for value in values], kind)


def _type(alias: str) -> pa.DataType:
    return DICTIONARY if alias == "dictionary" else pa.type_for_alias(alias)


def apply_to_table(operation: Operation, table: pa.Table, table_of: TableOf) -> pa.Table:
    """The table after one operation on rows or columns.

    Raises:
        ValueError: The operation does not fit the table.
    """
    if operation["op"] == "rows":
        return _rows_of(operation["keep"], table, table_of)
    if operation["op"] == "sort":
        return table.take(pc.sort_indices(table, [(name, "ascending") for name in operation["by"]]))
    if operation["op"] == "order":
        return table.select(operation["columns"])
    if operation["op"] == "nullable":
        names = operation["columns"]
        return table.cast(
            pa.schema([f.with_nullable(f.nullable or f.name in names) for f in table.schema], table.schema.metadata)
        )
    if operation["op"] == "describe":
        columns = operation["columns"]
        columns = dict.fromkeys(table.column_names) if columns is None else columns
        fields = [f.with_metadata(columns[f.name]) if f.name in columns else f for f in table.schema]
        return table.cast(pa.schema(fields, operation.get("table", table.schema.metadata)))
    return _apply_to_column(operation, table)


def _apply_to_column(operation: Operation, table: pa.Table) -> pa.Table:
    if "cells" in operation:
        which = {name: operation[name] for name in ("op", "rows", "where") if name in operation}
        for name, value in operation["cells"].items():
            table = _apply_to_column({**which, "column": name, "value": value}, table)
        return table
    name = operation["column"]
    if operation["op"] == "add_column":
        kind = _type(operation["type"])
        return table.append_column(pa.field(name, kind), _cells(operation, kind, len(table)))
    index = table.schema.get_field_index(name)
    if index < 0:
        raise ValueError(f"the table has no column {name!r}")
    field, column = table.schema.field(index), table.column(index).combine_chunks()
    if operation["op"] == "drop_column":
        return table.remove_column(index)
    if operation["op"] == "cast":
        kind = _type(operation["type"])
        if kind == DICTIONARY:
            return table.set_column(index, field.with_type(kind), column.cast(pa.string()).dictionary_encode())
        return table.set_column(index, field.with_type(kind), column.cast(kind, safe=False))
    rows = _where(operation["where"], table) if "where" in operation else _places(operation["rows"], len(table))
    if operation["op"] in ("scale", "shift"):
        values = column.to_numpy(zero_copy_only=False).copy()
        change = np.multiply if operation["op"] == "scale" else np.add
        values[rows] = change(values[rows].astype(np.float64), operation["by"])
        return table.set_column(index, field, pa.array(values, field.type))
    if "from" in operation or "of" in operation:
        source = table.column(operation.get("of", name)).combine_chunks()
        cells = source.take(pa.array(_places(operation["from"], len(table)) if "from" in operation else rows))
        if len(cells) != len(rows):
            raise ValueError(f"set of {name}: {len(cells)} values for {len(rows)} rows")
    else:
        cells = _cells(operation, field.type, len(rows))
    return table.set_column(index, field.with_nullable(True), _replaced(column, rows, cells))


def _replaced(column: pa.Array, rows: np.ndarray, cells: pa.Array) -> pa.Array:
    """The column with cells in the place of those at `rows`."""
    source = np.arange(len(column))
    source[rows] = len(column) + np.arange(len(rows))
    return pa.concat_arrays([column, cells]).take(pa.array(source))
