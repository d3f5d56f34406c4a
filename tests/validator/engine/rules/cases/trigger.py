"""Defects and limits of trigger evidence."""

from __future__ import annotations

from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import BRAKE, NOMINAL, REPLAY, boundary, mutant
from tests.validator.engine.rules.draft import Draft


def _place(column: str, rollout_id: str = BRAKE) -> dict[str, str]:
    return {"table": "rollouts", "column": column, "rollout_id": rollout_id}


@mutant("BD-TRG-001", at=_place("trigger_rollout_id"))
def trigger_read_from_the_intervention(d: Draft) -> None:
    d.set("rollouts", "trigger_rollout_id", BRAKE, rollout_id=BRAKE)


@mutant("BD-TRG-001", at=_place("trigger_rollout_id", NOMINAL))
def trigger_read_from_a_replay(d: Draft) -> None:
    d.set("rollouts", "trigger_rollout_id", REPLAY, rollout_id=NOMINAL)


@boundary("BD-TRG-001", "BD-TRG-002")
def trigger_at_the_branch(d: Draft) -> None:
    d.set("rollouts", "trigger_tick", BRANCH_TICK, group_id="g0")


@mutant("BD-TRG-002", at=_place("trigger_tick"))
def trigger_before_the_branch(d: Draft) -> None:
    d.set("rollouts", "trigger_tick", BRANCH_TICK - 1, rollout_id=BRAKE)


@mutant("BD-TRG-002", at=_place("trigger_tick"))
def trigger_after_the_nominal_ended(d: Draft) -> None:
    d.set("rollouts", "trigger_tick", 201, rollout_id=BRAKE)


@boundary("BD-TRG-002")
def trigger_at_the_last_tick_of_the_nominal(d: Draft) -> None:
    d.set("rollouts", "trigger_tick", 200, group_id="g0")
