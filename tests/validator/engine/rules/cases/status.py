"""Defects and limits of the status of an attempt."""

from __future__ import annotations

from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import (
    BRAKE,
    REPLAY,
    boundary,
    mutant,
)
from tests.validator.engine.rules.cases.ticks import BRANCH_COLUMNS
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.columns import TICK_TABLES

# BD-STA-001


@mutant("BD-STA-001", at={"rollout_id": "g0.brake_0.50.a2", "column": "status"}, lost=0)
def retry_that_ended_early(d: Draft) -> None:
    d.copy_attempt(BRAKE, "g0.brake_0.50.a2", attempt=2, status="partial", status_reason="the ego was stuck")
    for table in TICK_TABLES:
        d.drop(table, rollout_id="g0.brake_0.50.a2", tick=range(BRANCH_TICK + 7, 201))
    d.recount("g0.brake_0.50.a2")


@mutant("BD-STA-001", at={"rollout_id": REPLAY, "column": "status"}, lost=0)
def replay_that_the_collector_distrusts(d: Draft) -> None:
    d.set("rollouts", "status", "quarantined", rollout_id=REPLAY)
    d.set("rollouts", "status_reason", "the server lagged", rollout_id=REPLAY)


@mutant("BD-STA-001", at={"rollout_id": "g0.brake_0.50.a2", "column": "status"}, lost=0)
def attempt_without_any_row(d: Draft) -> None:
    d.duplicate(
        "rollouts",
        {
            "rollout_id": "g0.brake_0.50.a2", "attempt": 2, "status": "partial", "status_reason": "never began",
            "num_ticks": 0, "num_observations": 0, **dict.fromkeys(BRANCH_COLUMNS),
        },
        rollout_id=BRAKE,
    )  # fmt: skip


@boundary("BD-STA-001")
def complete_attempts_with_bad_results(d: Draft) -> None:
    d.set("rollouts", "result_completion", "aborted", rollout_id=BRAKE)
    d.set("rollouts", "result_num_vehicle_collisions", 1, rollout_id=BRAKE)
    d.set("evidence", "collision", True, rollout_id=BRAKE, tick=170)


# Several places: what violates a rule is counted


@mutant("BD-STA-001", at={"rollout_id": "g2.nominal_replay.a1"}, findings=2, lost=0)
def two_replays_that_the_collector_distrusts(d: Draft) -> None:
    for replay in (REPLAY, "g2.nominal_replay.a1"):
        d.set("rollouts", "status", "quarantined", rollout_id=replay)
        d.set("rollouts", "status_reason", "the server lagged", rollout_id=replay)
