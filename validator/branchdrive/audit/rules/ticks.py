"""Tick rules: the clock of controls and observations, and the branch on it.

Source: spec/02-time-frames-units.md, spec/05-raw-streams.md#control-ticks.
"""

from __future__ import annotations

import numpy as np

from branchdrive.audit.check import Mask, SubjectCheck, rollout_rule
from branchdrive.audit.finding import Sighting
from branchdrive.audit.view import ShardView, StreamView
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS


def _steps(stream: StreamView, step: int, subjects: Mask) -> SubjectCheck:
    """Ticks of each rollout start at 0 and increase by exactly `step`."""
    jump = np.ones(len(stream), bool)
    jump[1:] = np.diff(stream.tick) != step
    first = stream.start[stream.start < stream.stop]
    jump[first] = stream.tick[first] != 0
    summary = stream.by_rollout(jump)
    empty = stream.stop == stream.start

    def describe(i: int) -> Sighting:
        if empty[i]:
            return Sighting("rows", "none", {"table": stream.name})
        row = int(summary.first_row[i])
        here = int(stream.tick[row])
        if row == stream.start[i]:
            return Sighting(
                "tick 0 first",
                f"tick {here}",
                {"table": stream.name, "tick": here},
                int(summary.count[i]),
            )
        before = int(stream.tick[row - 1])
        return Sighting(
            f"tick {before + step} after tick {before}",
            f"tick {here}",
            {"table": stream.name, "tick": here},
            int(summary.count[i]),
        )

    return SubjectCheck(subjects, subjects & (summary.any | empty), describe)


@rollout_rule("BD-TIC-001")
def control_ticks_increase_by_one(view: ShardView, subjects: Mask) -> SubjectCheck:
    """``tick[0] = 0``, ``tick[i+1] = tick[i] + 1``."""
    return _steps(view.controls, 1, subjects)


@rollout_rule("BD-TIC-002")
def observations_keep_stride(view: ShardView, subjects: Mask) -> SubjectCheck:
    """``tick[0] = 0``, ``tick[i+1] = tick[i] + 5``."""
    return _steps(view.observations, OBSERVATION_STRIDE_TICKS, subjects)


@rollout_rule("BD-TIC-003")
def branch_is_an_observation_tick(view: ShardView, subjects: Mask) -> SubjectCheck:
    """``t_b = 5 * branch_frame``; an attempt without a branch cannot qualify."""
    frame = view.rollouts["branch_frame"].astype(np.int64)
    bad = ~view.branched | (view.branch_tick != frame * OBSERVATION_STRIDE_TICKS)

    def describe(i: int) -> Sighting:
        if not view.branched[i]:
            return Sighting("a branch tick", "no branch: the trigger found nothing", {"table": "rollouts"})
        found = f"branch_tick {view.branch_tick[i]} and branch_frame {frame[i]}"
        return Sighting("branch_tick = 5 x branch_frame", found, {"table": "rollouts", "column": "branch_tick"})

    return SubjectCheck(subjects, subjects & bad, describe)
