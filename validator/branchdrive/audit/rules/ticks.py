"""Tick rules: the clock of controls and observations, and the branch on it.

Source: spec/02-time-frames-units.md, spec/05-raw-streams.md#control-ticks.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from branchdrive.audit.view import StreamView
from branchdrive.contract.mismatch import Check, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive.raw.shard_view import ShardView


def _steps(stream: StreamView, step: int, subjects: Mask) -> Check:
    """Ticks of each rollout start at 0 and increase by exactly `step`."""
    jump = np.ones(len(stream), bool)
    jump[1:] = np.diff(stream.tick) != step
    first = stream.start[stream.start < stream.stop]
    jump[first] = stream.tick[first] != 0
    summary = stream.by_rollout(jump)
    empty = stream.stop == stream.start

    def describe(i: int) -> Mismatch:
        if empty[i]:
            return Mismatch({"table": stream.name}, "rows", "none")
        row = int(summary.first_row[i])
        here = int(stream.tick[row])
        if row == stream.start[i]:
            return Mismatch({"table": stream.name, "tick": here}, "tick 0 first", f"tick {here}", int(summary.count[i]))
        before = int(stream.tick[row - 1])
        return Mismatch(
            {"table": stream.name, "tick": here},
            f"tick {before + step} after tick {before}",
            f"tick {here}",
            int(summary.count[i]),
        )

    return Check.of_subjects(subjects, subjects & (summary.any | empty), describe)


@rule("BD-TIC-001")
def control_ticks_increase_by_one(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``tick[0] = 0``, ``tick[i+1] = tick[i] + 1``."""
    yield _steps(view.controls, 1, subjects)


@rule("BD-TIC-002")
def observations_keep_stride(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``tick[0] = 0``, ``tick[i+1] = tick[i] + 5``."""
    yield _steps(view.observations, OBSERVATION_STRIDE_TICKS, subjects)


@rule("BD-TIC-003")
def branch_is_an_observation_tick(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``t_b = 5 * branch_frame``; an attempt without a branch cannot qualify."""
    frame = view.rollouts["branch_frame"].astype(np.int64)
    bad = ~view.branched | (view.branch_tick != frame * OBSERVATION_STRIDE_TICKS)

    def describe(i: int) -> Mismatch:
        if not view.branched[i]:
            return Mismatch({"table": "rollouts"}, "a branch tick", "no branch: the trigger found nothing")
        found = f"branch_tick {view.branch_tick[i]} and branch_frame {frame[i]}"
        return Mismatch({"table": "rollouts", "column": "branch_tick"}, "branch_tick = 5 x branch_frame", found)

    yield Check.of_subjects(subjects, subjects & bad, describe)
