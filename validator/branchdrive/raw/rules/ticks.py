"""Tick rules: the clock of controls and observations, and the branch on it.

Source: spec/02-time-frames-units.md, spec/05-raw-streams.md#control-ticks.

Trigger rules: the branch was placed by the nominal rollout alone.

Source: paper III-B; spec/05-raw-streams.md#trigger.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from branchdrive.contract.mismatch import Check, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import StreamView

__all__ = []


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


@rule("BD-TRG-001")
def trigger_reads_the_nominal(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``trigger_rollout_id`` is the attempt's own nominal."""
    subjects = subjects & view.branched
    own = np.where(view.role("nominal"), view.rollouts["rollout_id"], view.rollouts["nominal_rollout_id"])
    named = view.rollouts["trigger_rollout_id"]

    def describe(i: int) -> Mismatch:
        return Mismatch({"table": "rollouts", "column": "trigger_rollout_id"}, quote(own[i]), quote(named[i]))

    yield Check.of_subjects(subjects, subjects & (own != named), describe)


@rule("BD-TRG-002")
def branch_precedes_trigger(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``t_b <= trigger_tick``, and the nominal rollout has a control row at the trigger tick."""
    subjects = subjects & view.branched
    tick = view.rollouts["trigger_tick"].astype(np.int64)
    inside = view.controls.find(view.nominal, tick) >= 0

    def describe(i: int) -> Mismatch:
        expected = f"a trigger tick of the nominal at or after branch tick {view.branch_tick[i]}"
        found = f"tick {tick[i]}" + ("" if inside[i] else ", which the nominal does not have")
        return Mismatch({"table": "rollouts", "column": "trigger_tick"}, expected, found)

    yield Check.of_subjects(subjects, subjects & ~(inside & (view.branch_tick <= tick)), describe)
