"""Where a group branches in its completed nominal rollout, by the kind of branch that was asked for.

* ``onset``: the last observation before the expert's manoeuvre, as the scenario's trigger finds it;
* ``early``: one of the observations 0.5 to 1 s before it, where the expert does not react yet;
* ``quiet``: one of the observations from which on the expert holds its commands for the whole window, drives straight
  on and does not brake, while somebody comes near. Where nobody does, separation decides nothing, and in a bend every
  action that lets go of the wheel is another manoeuvre.

All of them read the nominal rollout alone. Source: paper, Matched Intervention Protocol, for the onset; the other
kinds are this project's choice, docs/decisions/0022-branches-in-context.md.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from branchdrive.collector.trigger import MARGIN_TICKS, Branch
from branchdrive.contract.timing import (
    ACTIVE_TICKS,
    CONTROL_HISTORY_TICKS,
    FUTURE_OBSERVATIONS,
    OBSERVATION_STRIDE_TICKS,
)
from branchdrive_reference.noise import Purpose, choice
from branchdrive_reference.simulation.branch_kind import EARLY_TICKS, BranchKind
from branchdrive_reference.simulation.record import record
from branchdrive_reference.simulation.rollout import Run, find_branch

__all__ = [
    "MOST_EARLY_TICKS",
    "QUIET_CHANGE",
    "QUIET_DEFINITION",
    "QUIET_SEPARATION_M",
    "QUIET_SHIFT_M",
    "QUIET_STEER",
    "place_branch",
]

MOST_EARLY_TICKS = 20
"""Ticks from an early branch to the manoeuvre, at most."""

QUIET_DEFINITION = "quiet 1"

QUIET_CHANGE = 0.05
"""Largest change of any command of the expert in the window of a quiet branch."""

QUIET_STEER = 0.01
"""Largest steering command there, in magnitude."""

QUIET_SHIFT_M = 0.25
"""Largest offset from the route that it plans there: what shows a lane shift elsewhere."""

QUIET_SEPARATION_M = 2.0
"""Separation to which somebody comes near in that window: a little more than vehicles leave that pass each other."""


def place_branch(nominal: Run, kind: BranchKind) -> Branch | None:
    """The branch of a completed nominal rollout, or ``None`` where no branch of its kind is found."""
    if kind is BranchKind.QUIET:
        return _quiet(nominal)
    onset = find_branch(nominal)
    return _early(onset, nominal.spec.seed) if onset is not None and kind is BranchKind.EARLY else onset


def _early(onset: Branch, seed: int) -> Branch | None:
    first = -(-(onset.tick - MOST_EARLY_TICKS) // OBSERVATION_STRIDE_TICKS)
    last = (onset.tick - EARLY_TICKS) // OBSERVATION_STRIDE_TICKS
    tick = OBSERVATION_STRIDE_TICKS * (first + choice(last - first + 1, seed, Purpose.BRANCH_LEAD))
    if tick < CONTROL_HISTORY_TICKS:
        return None
    return replace(onset, branch_tick=tick, definition=onset.definition.replace("-onset", "-early"))


def _quiet(nominal: Run) -> Branch | None:
    log = nominal.log
    ticks = np.arange(CONTROL_HISTORY_TICKS, log.num_ticks - ACTIVE_TICKS - MARGIN_TICKS, OBSERVATION_STRIDE_TICKS)
    if not len(ticks):
        return None
    commands = sliding_window_view(log.expert.astype(np.float64), ACTIVE_TICKS, axis=0)[ticks]
    change = np.abs(commands - commands[:, :, :1]).max(axis=(1, 2))
    steer, brake = np.abs(commands[:, 0]).max(axis=1), commands[:, 2].max(axis=1)
    shift_m = sliding_window_view(np.abs(log.lane_shift_m), ACTIVE_TICKS)[ticks].max(axis=1)
    is_held = (change <= QUIET_CHANGE) & (steer <= QUIET_STEER) & (brake == 0.0) & (shift_m <= QUIET_SHIFT_M)
    found = np.flatnonzero(is_held & (_least_separation_m(nominal, ticks) <= QUIET_SEPARATION_M))
    if not len(found):
        return None
    place = found[choice(len(found), nominal.spec.seed, Purpose.BRANCH_QUIET)]
    tick = int(ticks[place])
    return Branch(tick, QUIET_DEFINITION, tick, "steady", float(change[place]), QUIET_CHANGE, 1.0)


def _least_separation_m(nominal: Run, ticks: NDArray[np.int64]) -> NDArray[np.float64]:
    """Least separation in the window behind each of `ticks`, infinite where there is none."""
    separation_m = np.ma.filled(record(nominal).evidence["separation_m"], np.inf)
    windows = sliding_window_view(separation_m, FUTURE_OBSERVATIONS)
    return np.asarray(windows[ticks // OBSERVATION_STRIDE_TICKS + 1].min(axis=1))
