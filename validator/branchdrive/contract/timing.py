"""The clock of a branch group: rates, windows and their offsets from the branch tick `t_b`.

Source: paper, "Branch-Group Representation" and "Two-Pass Collection"; spec/02-time-frames-units.md.
"""

from __future__ import annotations

__all__ = [
    "ACTIVE_TICKS",
    "CONTROL_HISTORY_TICKS",
    "FUTURE_OBSERVATIONS",
    "FUTURE_OFFSETS",
    "HISTORY_OBSERVATIONS",
    "HISTORY_OFFSETS",
    "OBSERVATION_STRIDE_TICKS",
    "PREDECESSOR_OFFSET",
    "TICK_S",
    "WINDOW_OFFSETS",
]

TICK_S = 0.05
"""Length of a simulator tick, seconds (20 Hz)."""

OBSERVATION_STRIDE_TICKS = 5
"""Ticks between two saved observations (4 Hz)."""

ACTIVE_TICKS = 50
"""Ticks of an intervention: active exactly for ``t_b <= t < t_b + 50`` (2.5 s)."""

CONTROL_HISTORY_TICKS = 80
"""Controls of the history: ``t_b - 80 .. t_b - 1``; the control of ``t_b`` is never in it."""

HISTORY_OBSERVATIONS = 16
"""Observations of the history: ``t_b - 75 .. t_b``."""

FUTURE_OBSERVATIONS = 10
"""Observations of the future: ``t_b + 5 j`` for ``j = 1 .. 10``."""

HISTORY_OFFSETS = tuple(range(-(HISTORY_OBSERVATIONS - 1) * OBSERVATION_STRIDE_TICKS, 1, OBSERVATION_STRIDE_TICKS))
"""Offsets of the history's observations from ``t_b``: -75, -70, .. 0."""

PREDECESSOR_OFFSET = -HISTORY_OBSERVATIONS * OBSERVATION_STRIDE_TICKS
"""Offset of the observation that backward differences of the first history row need: -80."""

FUTURE_OFFSETS = tuple(OBSERVATION_STRIDE_TICKS * j for j in range(1, FUTURE_OBSERVATIONS + 1))
"""Offsets of the future's observations from ``t_b``: 5, 10, .. 50."""

WINDOW_OFFSETS = (*HISTORY_OFFSETS, *FUTURE_OFFSETS)
"""Offsets of all 26 observations of history and future: those that media cover."""
