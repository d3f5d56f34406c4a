"""Every recorded column before the branch, as what the concordance of a leakage audit needs of it.

A column of a stream at one time is a number of every replay. Of a group's interventions their ranks are kept, and
how far apart the numbers lie: that is all a code needs to be seen, and it holds text and flags as well as metres.

Source: this project's choice; spec/13-leakage.md#streams.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import TABLES, Column
from branchdrive.contract.timing import CONTROL_HISTORY_TICKS, HISTORY_OFFSETS, PREDECESSOR_OFFSET

__all__ = ["COUNT", "WINDOWS", "StreamColumn", "Streams", "ranked", "stream_columns", "value_columns"]

Array = NDArray[np.float64]

WINDOWS: dict[str, tuple[int, ...]] = {
    "observations": (PREDECESSOR_OFFSET, *HISTORY_OFFSETS),
    "evidence": HISTORY_OFFSETS,
    "actors": HISTORY_OFFSETS,
    "controls": tuple(range(-CONTROL_HISTORY_TICKS, 0)),
}
"""Offsets from ``t_b`` at which a table is read, by table in the order of columns."""

COUNT = "number of rows"
"""What is read of the actors of a moment beside their values: how many there are."""


class StreamColumn(NamedTuple):
    """One column at one time.

    Attributes:
        table: Its table.
        name: Its name, or `COUNT`.
        offset_ticks: Offset from ``t_b``.
    """

    table: str
    name: str
    offset_ticks: int


@dataclass(frozen=True, eq=False, repr=False)
class Streams:
    """Columns of the interventions of groups.

    Attributes:
        columns: What the last axis holds.
        ranks: Centred doubled ranks within a group ``[groups, interventions, columns]``, ties averaged.
        spread: Largest difference of two numbers of a group ``[groups, columns]``, infinite beside a null.

    Raises:
        ValueError: A shape is wrong.
    """

    columns: tuple[StreamColumn, ...]
    ranks: NDArray[np.int16]
    spread: NDArray[np.float32]

    def __post_init__(self) -> None:
        if self.ranks.ndim != 3 or self.ranks.shape[2] != len(self.columns):
            raise ValueError(f"`ranks` has shape {list(self.ranks.shape)}, not [groups, interventions, columns]")
        if self.spread.shape != (len(self.ranks), len(self.columns)):
            raise ValueError(f"`spread` has shape {list(self.spread.shape)}, not [groups, columns]")

    def __repr__(self) -> str:
        return f"Streams(ranks {list(self.ranks.shape)} int16, spread {list(self.spread.shape)} float32)"

    @classmethod
    def none(cls, num_groups: int, num_interventions: int) -> Streams:
        """No column of any stream."""
        shape = (num_groups, num_interventions, 0)
        return cls((), np.zeros(shape, np.int16), np.zeros((num_groups, 0), np.float32))

    @property
    def are_identical(self) -> bool:
        """Whether all interventions of every group have the same numbers."""
        return not self.ranks.any()


def value_columns(table: str) -> tuple[Column, ...]:
    """Columns of a table that are read: all but the identity of the attempt and the tick."""
    return tuple(column for column in TABLES[table].columns if column.name not in ("rollout_id", "tick"))


def stream_columns(tables: tuple[str, ...]) -> tuple[StreamColumn, ...]:
    """Columns of the given tables: by table, by column in declared order, and by time."""
    found: list[StreamColumn] = []
    for table, offsets in WINDOWS.items():
        if table not in tables:
            continue
        at_moments = [column.name for column in value_columns(table)]
        if table == "actors":
            at_moments.append(COUNT)
        found += [StreamColumn(table, name, offset) for name in at_moments for offset in offsets]
    return tuple(found)


def ranked(values: Array) -> tuple[NDArray[np.int16], NDArray[np.float32]]:
    """Ranks ``[groups, rows, columns]`` and spread ``[groups, columns]`` of numbers ``[groups, rows, columns]``.

    A NaN stands for what is not there, below every number and infinitely far from it.
    """
    ordered = np.where(np.isnan(values), -np.inf, values)
    ranks = np.zeros(values.shape, np.int16)
    for other in range(values.shape[1]):
        ranks += ordered > ordered[:, other : other + 1]
        ranks -= ordered < ordered[:, other : other + 1]
    low, high = ordered.min(axis=1, initial=np.inf), ordered.max(axis=1, initial=-np.inf)
    with np.errstate(invalid="ignore", over="ignore"):
        spread = np.where(low < high, high - low, 0.0).astype(np.float32)
    return ranks, spread
