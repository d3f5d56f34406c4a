"""Status rule: what the simulator or the collector says about an attempt. Source: spec/05-raw-streams.md#status."""

from __future__ import annotations

from collections.abc import Iterator

from branchdrive.contract.mismatch import Check, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.raw.shard_view import ShardView

ATTEMPT_IS_COMPLETE = "BD-STA-001"
"""The one rule on attempts that are not complete; every other rule examines complete ones."""


@rule(ATTEMPT_IS_COMPLETE)
def attempt_is_complete(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Partial and quarantined attempts stay in the dataset and qualify for nothing."""

    def describe(i: int) -> Mismatch:
        status, reason = view.rollouts["status"][i], view.rollouts["status_reason"][i]
        return Mismatch(
            {"table": "rollouts", "column": "status"}, "status complete", f"{quote(status)}: {quote(reason)}"
        )

    yield Check.of_subjects(subjects, subjects & ~view.complete, describe)
