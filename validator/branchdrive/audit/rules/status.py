"""Status rule: what the simulator or the collector says about an attempt. Source: spec/05-raw-streams.md#status."""

from __future__ import annotations

from branchdrive.audit.check import Mask, SubjectCheck, rollout_rule
from branchdrive.audit.finding import Sighting, quote
from branchdrive.audit.view import ShardView

ATTEMPT_IS_COMPLETE = "BD-STA-001"
"""The one rule on attempts that are not complete; every other rule examines complete ones."""


@rollout_rule(ATTEMPT_IS_COMPLETE)
def attempt_is_complete(view: ShardView, subjects: Mask) -> SubjectCheck:
    """Partial and quarantined attempts stay in the dataset and qualify for nothing."""

    def describe(i: int) -> Sighting:
        status, reason = view.rollouts["status"][i], view.rollouts["status_reason"][i]
        return Sighting(
            "status complete", f"{quote(status)}: {quote(reason)}", {"table": "rollouts", "column": "status"}
        )

    return SubjectCheck(subjects, subjects & ~view.complete, describe)
