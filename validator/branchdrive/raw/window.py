"""Rows of the canonical windows of a shard's rollouts, and values there.

Source: spec/02-time-frames-units.md#windows.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import WINDOW_OFFSETS
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import StreamView, TableView

__all__ = ["EVIDENCE_OFFSETS", "take_float", "window_rows"]

Index = NDArray[np.int64]

EVIDENCE_OFFSETS = WINDOW_OFFSETS
"""Offsets of the evidence window from ``t_b``: -75, -70, .. 50."""


def window_rows(view: ShardView, stream: StreamView, rollouts: Index, offsets: Sequence[int]) -> Index:
    """Rows of `stream` at ``t_b + offset``, ``[rollouts, offsets]``; -1 where there is none or more than one."""
    ticks = view.branch_tick[rollouts][:, None] + np.asarray(offsets)
    rows = stream.find(np.broadcast_to(rollouts[:, None], ticks.shape), ticks)
    is_repeated = np.append(stream.repeats, False)[rows + 1]
    return np.where(is_repeated, -1, rows)


def take_float(table: TableView, column: str, rows: NDArray[Any]) -> NDArray[np.float64]:
    """Values of a numeric column at `rows`, float64, NaN where null."""
    values = np.asarray(table[column][rows], np.float64)
    return np.where(table.valid(column)[rows], values, np.nan)
