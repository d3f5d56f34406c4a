"""Columns of a pilot that say nothing, or that were not measured: constant, absent, copied, rounded.

What describes a whole collection may be the same in all of it; what an actuator, a sensor or a simulator gives may not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import TABLES
from branchdrive.contract.text import quote
from branchdrive.driving.response import NO_RESPONSE
from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.section import Concern, Section
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import TableView
from branchdrive.text.table import Column, Table

__all__ = ["columns"]

_DESCRIBING = (
    "status", "status_reason", "attempt", "protocol_variant", "environment", "repetition", "provenance", "ego_",
    "trigger_", "simulator_version", "collector_version", "effective_", "active", "source", "marking",
)  # fmt: skip
"""Beginnings of columns that describe a collection, and may be the same or absent in all of it."""

_MEASURED = ("observations", "actors")
"""Tables of what a simulator measures; commands are decided, and evidence is recomputed by rules."""

_DERIVED = ("route_", "target_point_")
"""Beginnings of columns that rules recompute from others, so that one that is constant or a copy is geometry."""

_SET = ("speed_limit_mps", "length_m", "width_m", "height_m")
"""Measured columns that may well have one value everywhere."""

_SAME = {
    ("controls", "intended_steer", "applied_steer"),
    ("controls", "intended_throttle", "applied_throttle"),
    ("controls", "intended_brake", "applied_brake"),
    ("evidence", "separation_m", "nearest_vehicle_gap_m"),
    ("rollouts", "num_ticks", "num_observations"),
}
"""Columns of one table that the specification makes equal, or that may well be."""

_MIN_DISTINCT = 20
"""Values of which at least so many differ are measured, and then neither all round nor all those of another column."""

_SAYS = {"constant": "is the same in every row: ", "copied": "is ", "rounded": "has "}

_REMEDIES = {
    "constant": "Record what the simulator has, or nothing: a column that it cannot offer is null and listed as "
    "`unrecorded` in the descriptor, where the specification allows that.",
    "copied": "Record each of the two from its own source; one that is not measured belongs into `unrecorded`.",
    "rounded": "Record the simulator's own numbers, as they are: what is rounded loses what happens between two ticks.",
}
"""What to do about columns of each kind; absent ones are declared, or break a rule."""

_MAX_DECIMALS = 2
_FLOAT32 = 1e-6


def columns(pilot: Pilot) -> Section:
    """Columns that are constant, absent, a copy of another one, or all round."""
    title = "Columns"
    if not pilot.parts:
        return Section("columns", title, not_examined=[pilot.unread])
    is_tried = bool((pilot.responses().first != NO_RESPONSE).any())
    rows: list[list[str]] = []
    describing: list[str] = []
    measured: dict[str, list[str]] = {}
    found: dict[str, list[str]] = {"constant": [], "absent": [], "copied": [], "rounded": []}
    num_columns = 0
    for name in pilot.descriptor.tables:
        table = _Columns(name, [part.view for part in pilot.parts])
        num_columns += len(table.names)
        for kind, column, says in table.noted():
            found[kind].append(f"{name}.{column}")
            if column.startswith(_DESCRIBING):
                describing.append(column)
                continue
            rows.append([name, column, kind, says])
            if table.is_telling(column, kind) and (is_tried or kind != "constant"):  # nominals may go straight on
                measured.setdefault(kind, []).append(f"{name}.{column} {_SAYS[kind]}{says}")
    facts = [
        f"{num_columns} columns of {len(pilot.descriptor.tables)} tables: "
        + ", ".join(f"{len(names)} {kind}" for kind, names in found.items())
        + "."
    ]
    if describing:
        facts.append(f"Of them describe the collection, and may be the same in all of it: {', '.join(describing)}.")
    declared = list(pilot.descriptor.unrecorded)
    if declared:
        facts.append(f"Declared as unrecorded: {', '.join(declared)}.")
    concerns = [Concern(f"{'; '.join(named)}.", _REMEDIES[kind], is_problem=False) for kind, named in measured.items()]
    heads = [Column.name("Table"), Column.name("Column"), Column("What", is_text=True), Column("Says", is_text=True)]
    tables = [Table("Columns that are the same everywhere, absent, copied or round", heads, rows)] if rows else []
    return Section("columns", title, facts, concerns, tables, figures={**found, "unrecorded": declared})


class _Columns:
    """Columns of one table over all shards."""

    def __init__(self, name: str, views: Sequence[ShardView]) -> None:
        self.name = name
        self._views = [view[name] for view in views]
        self._types = {column.name: column.type for column in TABLES[name].columns}
        self.names = [column for column, kind in self._types.items() if not kind.startswith("list")]

    def is_measured(self, column: str) -> bool:
        """Whether a simulator or an expert gives the number, and it is another one from moment to moment."""
        is_number = self._types[column].startswith("float")
        return self.name in _MEASURED and is_number and not column.startswith(_DERIVED) and column not in _SET

    def is_telling(self, column: str, kind: str) -> bool:
        """Whether it is worth a word that a column is constant, copied or rounded; parked actors do not move."""
        return self.is_measured(column) and (kind == "rounded" or (kind != "absent" and self.name == "observations"))

    def noted(self) -> Iterator[tuple[str, str, str]]:
        """Kind, column and what there is to say."""
        numbers: dict[str, tuple[NDArray[Any], NDArray[np.bool_]]] = {}
        num_rows = sum(map(len, self._views))
        for column in self.names:
            valid = np.concatenate([np.zeros(0, bool), *(view.valid(column) for view in self._views)])
            if num_rows and not valid.any():
                yield "absent", column, "null in every row"
                continue
            distinct = self._distinct(column)
            if len(distinct) == 1 and num_rows > 1:
                yield "constant", column, _text(distinct[0]) + ("" if valid.all() else " wherever it is not null")
                continue
            if self._types[column].startswith("float") and len(distinct) >= _MIN_DISTINCT:
                values = np.concatenate([view[column] for view in self._views])
                decimals = _decimals(np.asarray(distinct, np.float64))
                if decimals is not None and self.is_measured(column):
                    yield "rounded", column, f"no value with more than {decimals} decimals, {len(distinct):,} in all"
                if column.startswith(_DERIVED):
                    continue
                other = next(
                    (name for name in numbers if self._is_copy(name, column, numbers[name], (values, valid))), ""
                )
                if other:
                    yield "copied", column, f"equal to {other}"
                numbers[column] = values, valid

    def _distinct(self, column: str) -> Sequence[Any]:
        """Different values that are not null."""
        if self._types[column] == "string":
            return sorted({text for view in self._views for text in _present(view, column)})
        values = np.concatenate([view[column][view.valid(column)] for view in self._views])
        found: Sequence[Any] = np.unique(values).tolist()
        return found

    def _is_copy(
        self,
        first: str,
        second: str,
        one: tuple[NDArray[Any], NDArray[np.bool_]],
        other: tuple[NDArray[Any], NDArray[np.bool_]],
    ) -> bool:
        if (self.name, first, second) in _SAME:
            return False
        both = one[1] & other[1]
        values = one[0][both]
        return len(np.unique(values)) >= _MIN_DISTINCT and bool((values == other[0][both]).all())


def _present(view: TableView, column: str) -> Iterator[str]:
    codes, categories = view.categories(column)
    return (categories[code] for code in np.unique(codes).tolist() if code >= 0)


def _text(value: Any) -> str:
    return f"{value:.7g}" if isinstance(value, float) else quote(value)


def _decimals(values: NDArray[np.float64]) -> int | None:
    """Decimals that all values have at most, ``None`` where they have more than are round."""
    for decimals in range(_MAX_DECIMALS + 1):
        if (np.abs(values - np.round(values, decimals)) <= _FLOAT32 * np.maximum(1, np.abs(values))).all():
            return decimals
    return None
