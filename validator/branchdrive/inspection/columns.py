"""Columns of a stored table: what is declared of each, and what the rows of one file hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from branchdrive.contract.columns import Column, Table
from branchdrive.contract.text import NONE, counted, percent, printable

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["StoredColumn", "stored_columns"]

_NAMED = 4
"""Texts of a column that are named."""

_FEW = 16
"""Of more texts none is named: they are identifiers."""

_TEXT_CHARACTERS = 24


@dataclass(frozen=True)
class StoredColumn:
    """A column as it is stored.

    Attributes:
        name: As the file has it.
        type: Arrow type, text without its dictionary.
        unit: Declared unit; empty of others and of a column that is not declared.
        track: Declared track, which says what may read it; empty of a column that is not declared.
        nulls: Share of rows without a value.
        values: What the others are, in a few words.
    """

    name: str
    type: str
    unit: str
    track: str
    nulls: str
    values: str


def stored_columns(table: pa.Table, declared: Table | None) -> list[StoredColumn]:
    """Columns of a decoded table, in its order."""
    known = {column.name: column for column in declared.columns} if declared else {}
    return [_stored(name, table.column(name), known) for name in table.column_names]


def _stored(name: str, values: pa.ChunkedArray, known: Mapping[str, Column]) -> StoredColumn:
    import pyarrow as pa

    kind = values.type.value_type if pa.types.is_dictionary(values.type) else values.type
    about = known.get(name)
    nulls = percent(values.null_count / len(values), 0) if values.null_count else ""
    return StoredColumn(
        name,
        str(kind),
        (about.unit or "") if about else "",
        about.track if about else "",
        nulls,
        _values(values, kind),
    )


def _values(values: pa.ChunkedArray, kind: pa.DataType) -> str:
    """Range of numbers, share of true ones, or some of the texts."""
    import pyarrow as pa
    import pyarrow.compute as pc

    found = values.drop_null()
    if not len(found):
        return NONE
    if pa.types.is_boolean(kind):
        return f"{percent(pc.mean(found.cast(pa.int8())).as_py(), 0)} true"
    if pa.types.is_integer(kind) or pa.types.is_floating(kind):
        extremes = pc.min_max(found).as_py()
        low, high = (f"{extremes[end]:.6g}" for end in ("min", "max"))
        return low if low == high else f"{low} .. {high}"
    if pa.types.is_string(kind):
        texts_of_rows = found.cast(pa.string())
        num_texts = pc.count_distinct(texts_of_rows).as_py()
        texts = pc.value_counts(texts_of_rows).to_pylist() if num_texts <= _FEW else []
        texts.sort(key=lambda count: (-count["counts"], count["values"]))
        named = ", ".join(_short(count["values"]) for count in texts[:_NAMED])
        return named if num_texts <= _NAMED else f"{counted(num_texts, 'text')}" + (f": {named}, .." if named else "")
    return ""


def _short(text: str) -> str:
    shown = printable(text)
    return shown if len(shown) <= _TEXT_CHARACTERS else shown[: _TEXT_CHARACTERS - 2] + ".."
