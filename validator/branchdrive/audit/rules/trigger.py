"""Trigger rules: the branch was placed by the nominal rollout alone.

Source: paper III-B; spec/05-raw-streams.md#trigger.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from branchdrive.contract.mismatch import Check, Mask, Mismatch, quote
from branchdrive.contract.rule import rule
from branchdrive.raw.shard_view import ShardView


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
