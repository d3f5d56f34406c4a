"""Edits of single cells of every column of every table: by values that are plainly wrong, and by ones that are not."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
from tests.fuzz.draw import Draw

from branchdrive.contract.columns import LAYER_TABLES, TABLES, Column
from branchdrive.contract.layer import table_file
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.untrusted_parquet import decode_table
from branchdrive.testing.defect import with_cells

__all__ = ["KINDS", "SUBTLE", "CellEdit", "Place", "edit_cell", "places"]

HOSTILE_TEXT = (
    "'; DROP TABLE rollouts; --", "<script>alert(1)</script>", "\x1b[2J\x1b]0;owned\x07", "a\nBD-VAL-001 pass\n",
    "\u202eabc", "../../etc/passwd", "x" * 100_000, "\x00", "{{7*7}}", "%s%n", "", " ",
)  # fmt: skip
"""Text that means something to a database, a page, a terminal, a report or a path."""


@dataclass(frozen=True)
class Place:
    """A column of a table file of a dataset; `path` is relative to its root."""

    path: str
    table: str
    column: Column

    @property
    def name(self) -> str:
        """The column as reports name it, shards left out."""
        layer = self.path.split("/")[0]
        return f"{layer}/{self.table}.{self.column.name}"


@dataclass(frozen=True)
class CellEdit:
    """A table file with one cell changed."""

    place: Place
    kind: str
    what: str
    content: bytes


def places(root: Path) -> list[Place]:
    """Columns of all table files of a dataset."""
    declared = {**TABLES, **LAYER_TABLES}
    paths = sorted(path.relative_to(root).as_posix() for path in root.rglob("*.parquet"))
    files = {path: table_file(path) for path in paths}
    tables = {path: Path(path).stem if file is None else file.table for path, file in files.items()}
    return [Place(path, name, column) for path, name in tables.items() for column in declared[name].columns]


def _near(draw: Draw, column: Column, old: Any) -> Any:
    """A neighbour of a value."""
    if column.values:
        return draw.choice(column.values)
    match old:
        case bool():
            return not old
        case int():
            return old + draw.choice((-5, -1, 1, 5))
        case float():
            return old + draw.choice((-1, 1)) * draw.choice((1e-3, 1e-2, 0.1)) * (1 + abs(old))
        case str():
            return old[:-1] + ("1" if old.endswith("0") else "0")
    return old


def _far(draw: Draw, column: Column, old: Any) -> Any:
    """Any value of the declared range."""
    match old:
        case bool():
            return not old
        case int() | float():
            low = -1e3 if column.min is None else column.min
            high = 1e3 if column.max is None else column.max
            value = low + (high - low) * draw.below(2**20) / 2**20
            return int(value) if isinstance(old, int) else value
        case str():
            return draw.choice(column.values) if column.values else "elsewhere"
    return old


def _refused(draw: Draw, column: Column, old: Any) -> Any:
    """A value that no declaration allows, where there is one."""
    match old:
        case bool():
            return None
        case int():
            return draw.choice((-(2**31), 2**31 - 1))
        case float():
            return draw.choice((math.nan, math.inf, -math.inf, 1e308, -1e30))
        case str():
            return draw.choice(HOSTILE_TEXT)
    return None


KINDS: Mapping[str, Callable[[Draw, Column, Any], Any]] = {
    "null": lambda draw, column, old: None,
    "refused": _refused,
    "near": _near,
    "far": _far,
}
"""What a cell becomes, by kind; ``other`` is the value of another row."""

SUBTLE = ("near", "far", "other")
"""Kinds whose values the declaration of the column allows."""

_tables: dict[Path, pa.Table] = {}


def _table(path: Path, name: str) -> pa.Table:
    if path not in _tables:
        _tables[path] = decode_table(path.read_bytes(), name)
    return _tables[path]


def edit_cell(draw: Draw, root: Path, place: Place) -> CellEdit | None:
    """One cell of a column changed; ``None`` where the column has no other value to take."""
    table = _table(root / place.path, place.table)
    if not len(table):
        return None
    values = table[place.column.name].to_pylist()
    for _ in range(8):
        kind = draw.choice((*KINDS, "other"))
        row = draw.below(len(values))
        old = values[row]
        new = _new_value(draw, place.column, kind, old, values)
        if new == old or (new != new and old != old):
            continue
        try:
            content = encode_table(with_cells(table, place.column.name, {row: new}))
        except (pa.ArrowException, OverflowError):  # the type holds no such value
            continue
        return CellEdit(place, kind, f"{kind}: row {row}, {old!r:.60} to {new!r:.60}", content)
    return None


def _new_value(draw: Draw, column: Column, kind: str, old: Any, values: list[Any]) -> Any:
    if kind == "other":
        return draw.choice(values)
    if isinstance(old, list) and old and kind != "null":
        place = draw.below(len(old))
        return [*old[:place], KINDS[kind](draw, column, old[place]), *old[place + 1 :]]
    known = next((value for value in values if value is not None), None) if old is None else old
    return KINDS[kind](draw, column, known)
