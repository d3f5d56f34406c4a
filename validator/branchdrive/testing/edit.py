"""Edits of Arrow tables: single columns, cells and rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pyarrow as pa

__all__ = ["with_cells", "with_column", "without_row"]


def with_column(table: pa.Table, column: str, values: Any) -> pa.Table:
    """A table with one column replaced, which may hold nulls if the new values do."""
    index = table.schema.get_field_index(column)
    field = table.schema.field(index)
    array = values if isinstance(values, pa.Array) else pa.array(values, field.type)
    return table.set_column(index, field.with_nullable(field.nullable or array.null_count > 0), array)


def with_cells(table: pa.Table, column: str, cells: Mapping[int, Any]) -> pa.Table:
    """A table with some cells of one column, by row, replaced."""
    values = table[column].to_pylist()
    for row, value in cells.items():
        values[row] = value
    return with_column(table, column, values)


def without_row(table: pa.Table, row: int) -> pa.Table:
    """A table without one row."""
    return pa.concat_tables([table[:row], table[row + 1 :]]).combine_chunks()
