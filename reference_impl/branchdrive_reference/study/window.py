"""Rollouts of a shard that hold every canonical window, and that intervene as their policy says.

Source: spec/02-time-frames-units.md#windows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.timing import ACTIVE_TICKS, CONTROL_HISTORY_TICKS, PREDECESSOR_OFFSET
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import EVIDENCE_OFFSETS, window_rows

__all__ = ["active_as_declared", "windows_are_whole"]

Mask = NDArray[np.bool_]

_OBSERVATION_OFFSETS = (PREDECESSOR_OFFSET, *EVIDENCE_OFFSETS)
_CONTROL_OFFSETS = range(-CONTROL_HISTORY_TICKS, ACTIVE_TICKS + 1)


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
