"""What tells two datasets apart, by attempt, row, column and member.

Source: spec/03-layout.md#content.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from branchdrive.contract.comparison import is_number
from branchdrive.contract.mismatch import Location
from branchdrive.contract.text import quote

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["ColumnDifference", "DatasetDifference", "DifferentCell", "TableDifference"]


@dataclass(frozen=True)
class DifferentCell:
    """One cell that differs: the key of its row, and both values as text."""

    location: Location
    ours: str
    theirs: str


@dataclass
class ColumnDifference:
    """Cells of a column that differ, by how much numbers do at most, and the first of them."""

    num_cells: int = 0
    largest: float | None = None
    first: DifferentCell | None = None

    def add(self, ours: pa.ChunkedArray, theirs: pa.ChunkedArray, location: Callable[[int], Location]) -> None:
        """Count the cells of two columns of one length that differ; `location` says where a row is."""
        mine, others = ours.to_pylist(), theirs.to_pylist()
        pairs = [
            (row, one, other)
            for row, (one, other) in enumerate(zip(mine, others, strict=True))
            if not _same(one, other)
        ]
        self.num_cells += len(pairs)
        numbers = [abs(one - other) for _, one, other in pairs if is_number(one) and is_number(other)]
        if numbers:
            self.largest = max(float(max(numbers)), self.largest or 0.0)
        if pairs and self.first is None:
            row, one, other = pairs[0]
            self.first = DifferentCell(location(row), quote(one), quote(other))


@dataclass
class TableDifference:
    """Rows of a table that one dataset alone has, and columns whose cells differ in rows that both have."""

    only_first: int = 0
    only_second: int = 0
    columns: dict[str, ColumnDifference] = field(default_factory=dict)

    def add(self, ours: pa.Table, theirs: pa.Table, key: Sequence[str]) -> None:
        """Compare rows of two tables that belong together, one by one; `key` names columns that tell where a row is."""

        def location(row: int) -> Location:
            return {name: ours[name][row].as_py() for name in key}

        for name in ours.column_names:
            if not ours[name].equals(theirs[name]) or _has_zeros(ours[name]):
                found = self.columns.get(name, ColumnDifference())
                found.add(ours[name], theirs[name], location)
                if found.num_cells:
                    self.columns[name] = found


@dataclass
class DatasetDifference:
    """What tells two datasets apart.

    Attributes:
        descriptor: Members of the descriptors that differ, but for the claimed layers.
        layers: Layers that count for identity and that one dataset alone claims.
        files: Files that differ, are in the first alone and in the second alone, as the manifests have them.
        beside: Names in the folder of the first alone and of the second alone that are no part of the dataset.
        only_first: Attempts that the first dataset alone has.
        only_second: Attempts that the second alone has.
        changed: Attempts of both whose data differ.
        towns: Towns whose maps differ, or that one dataset alone has a map of.
        tables: Tables whose rows differ, by path in a derived layer and by name in the raw one.
        documents: Members of documents that differ, by path.
    """

    descriptor: list[str] = field(default_factory=list)
    layers: list[str] = field(default_factory=list)
    files: tuple[int, int, int] = (0, 0, 0)
    beside: tuple[list[str], list[str]] = field(default_factory=lambda: ([], []))
    only_first: list[str] = field(default_factory=list)
    only_second: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    towns: list[str] = field(default_factory=list)
    tables: dict[str, TableDifference] = field(default_factory=dict)
    documents: dict[str, list[str]] = field(default_factory=dict)

    @property
    def first_cell(self) -> tuple[str, str, DifferentCell] | None:
        """Table, column and place of the first cell that differs: in the first attempt, at its earliest tick.

        Cells without a tick, such as those of the rollouts table, come after those of the attempt that have one.
        """
        cells = [
            (name, column, found.first)
            for name, table in self.tables.items()
            for column, found in table.columns.items()
            if found.first is not None
        ]
        return min(cells, key=lambda cell: _moment(cell[2].location), default=None)

    @property
    def has_equal_data(self) -> bool:
        """Whether every layer says the same in both."""
        raw = (self.only_first, self.only_second, self.changed, self.towns)
        return not (self.layers or any(raw) or self.tables or self.documents)


def _moment(location: Location) -> tuple[str, float]:
    return str(location.get("rollout_id", "")), float(location.get("tick", math.inf))


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return np.float64(one).tobytes() == np.float64(other).tobytes()
    return bool(one == other)


def _has_zeros(column: pa.ChunkedArray) -> bool:
    """Whether equal values may differ by the sign of a zero."""
    import pyarrow as pa
    import pyarrow.compute as pc

    return pa.types.is_floating(column.type) and bool(pc.any(pc.equal(column, 0.0)).as_py())
