"""Rows of the canonical windows of a shard's rollouts, and which rollouts hold every one of them.

Source: spec/02-time-frames-units.md#windows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from branchdrive.audit.view import ShardView, StreamView
from branchdrive.contract.timing import (
    ACTIVE_TICKS,
    CONTROL_HISTORY_TICKS,
    FUTURE_OFFSETS,
    HISTORY_OFFSETS,
    PREDECESSOR_OFFSET,
)

__all__ = ["EVIDENCE_OFFSETS", "active_as_declared", "window_rows", "windows_are_whole"]

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

EVIDENCE_OFFSETS = (*HISTORY_OFFSETS, *FUTURE_OFFSETS)
"""Offsets of the evidence window from ``t_b``: -75, -70, .. 50."""

_OBSERVATION_OFFSETS = (PREDECESSOR_OFFSET, *EVIDENCE_OFFSETS)
_CONTROL_OFFSETS = range(-CONTROL_HISTORY_TICKS, ACTIVE_TICKS + 1)


def window_rows(view: ShardView, stream: StreamView, rollouts: Index, offsets: Sequence[int]) -> Index:
    """Rows of `stream` at ``t_b + offset``, ``[rollouts, offsets]``; -1 where there is none or more than one."""
    ticks = view.branch_tick[rollouts][:, None] + np.asarray(offsets)
    rows = stream.find(np.broadcast_to(rollouts[:, None], ticks.shape), ticks)
    is_repeated = np.append(stream.repeats, False)[rows + 1]
    return np.where(is_repeated, -1, rows)


def windows_are_whole(view: ShardView) -> Mask:
    """Rollouts with a branch that hold every row of every window once, ``[rollouts]``."""
    every = np.arange(view.num_rollouts)
    whole = view.branched.copy()
    wanted = {"controls": _CONTROL_OFFSETS, "observations": _OBSERVATION_OFFSETS, "evidence": EVIDENCE_OFFSETS}
    for table, offsets in wanted.items():
        if table in view:
            whole &= (window_rows(view, view.stream(table), every, offsets) >= 0).all(axis=1)
    return whole


def active_as_declared(view: ShardView) -> Mask:
    """Rollouts that intervene exactly at ``t_b .. t_b + duration - 1``, the duration being the bank's, ``[rollouts]``.

    Nominal rollouts and nominal replays never intervene.
    """
    durations = np.array([policy.duration_ticks for policy in view.descriptor.action_bank.policies] + [-1])
    duration = durations[view.policy]
    rows = view.active_rows
    owner, tick = view.controls.rollout[rows], view.controls.tick[rows]
    inside = (tick >= view.branch_tick[owner]) & (tick < view.branch_tick[owner] + duration[owner])
    num_active = np.bincount(owner, minlength=view.num_rollouts)
    num_inside = np.bincount(owner[inside], minlength=view.num_rollouts)
    return np.asarray((num_active == duration) & (num_inside == duration))
