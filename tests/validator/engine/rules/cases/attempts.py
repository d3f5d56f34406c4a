"""Defects and limits of the status of attempts and of their ticks."""

from __future__ import annotations

import numpy as np
from tests.synthetic import BRANCH_TICK, make_group, plans
from tests.validator.engine.rules.case import BRAKE, NOMINAL, REPLAY, SHARD_0, boundary, mutant
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.columns import TICK_TABLES

BRANCH_COLUMNS = (
    "branch_tick", "branch_frame", "trigger_definition", "trigger_rollout_id", "trigger_tick", "trigger_signal",
    "trigger_value", "trigger_threshold", "trigger_confidence",
)  # fmt: skip

LAST_TICK = 200


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


# BD-TIC-001


@mutant("BD-TIC-001", at={"rollout_id": BRAKE, "table": "controls", "tick": 11})
def tick_missing(d: Draft) -> None:
    d.drop("controls", rollout_id=BRAKE, tick=10)
    d.recount(BRAKE)


@mutant("BD-TIC-001", at={"rollout_id": BRAKE, "table": "controls", "tick": 10})
def tick_twice(d: Draft) -> None:
    d.duplicate("controls", rollout_id=BRAKE, tick=10)
    d.recount(BRAKE)


@mutant("BD-TIC-001", at={"rollout_id": BRAKE, "table": "controls", "tick": 1})
def ticks_from_one(d: Draft) -> None:
    d.drop("controls", rollout_id=BRAKE, tick=0)
    d.recount(BRAKE)


@mutant("BD-TIC-001", at={"rollout_id": REPLAY, "table": "controls", "tick": 190}, lost=0)
def tick_missing_after_the_window_of_a_replay(d: Draft) -> None:
    d.drop("controls", rollout_id=REPLAY, tick=189)
    d.recount(REPLAY)


@boundary("BD-TIC-001", "BD-TIC-002")
def rows_in_reverse_order(d: Draft) -> None:
    for table in ("controls", "observations"):
        d.map_table(table, lambda rows: rows.take(np.arange(len(rows))[::-1]), folder=SHARD_0)


# BD-TIC-002


@mutant("BD-TIC-002", at={"rollout_id": BRAKE, "table": "observations", "tick": 10})
def observation_missing(d: Draft) -> None:
    d.drop_observation(BRAKE, 5)


@mutant("BD-TIC-002", at={"rollout_id": BRAKE, "table": "observations", "tick": 5})
def observation_twice(d: Draft) -> None:
    d.duplicate("observations", rollout_id=BRAKE, tick=5)
    d.recount(BRAKE)


@mutant("BD-TIC-002", at={"rollout_id": BRAKE, "table": "observations", "tick": 5})
def observations_from_tick_five(d: Draft) -> None:
    d.drop_observation(BRAKE, 0)


@mutant("BD-TIC-002", at={"rollout_id": BRAKE, "table": "observations", "tick": 3})
def observation_between_two(d: Draft) -> None:
    d.duplicate("observations", {"tick": 3}, rollout_id=BRAKE, tick=5)
    d.recount(BRAKE)


@mutant("BD-TIC-002", at={"rollout_id": BRAKE, "table": "observations", "tick": LAST_TICK - 5})
def observations_that_end_before_the_controls(d: Draft) -> None:
    d.drop_observation(BRAKE, LAST_TICK)


@mutant("BD-TIC-002", at={"rollout_id": BRAKE, "table": "observations", "tick": LAST_TICK})
def observations_that_go_on_after_the_controls(d: Draft) -> None:
    d.drop("controls", rollout_id=BRAKE, tick=range(LAST_TICK - 1, LAST_TICK + 1))
    d.recount(BRAKE)


@boundary("BD-TIC-002", "BD-WIN-002", "BD-WIN-004")
def observation_after_the_last_control(d: Draft) -> None:
    d.drop("controls", rollout_id=BRAKE, tick=LAST_TICK)
    d.recount(BRAKE)


# BD-TIC-003


@mutant("BD-TIC-003", at={"group_id": "g0", "column": "branch_tick"}, findings=15)
def frames_counted_from_one(d: Draft) -> None:
    d.set("rollouts", "branch_frame", lambda frame: frame + 1, group_id="g0")


@mutant("BD-TIC-003", at={"rollout_id": NOMINAL, "table": "rollouts"}, findings=15)
def group_without_a_branch(d: Draft) -> None:
    d.set("rollouts", BRANCH_COLUMNS, None, group_id="g0")


@mutant("BD-TIC-003", at={"rollout_id": REPLAY, "column": "branch_tick"}, lost=0)
def replay_that_lost_its_branch_frame(d: Draft) -> None:
    d.set("rollouts", "branch_frame", 0, rollout_id=REPLAY)


@boundary("BD-TIC-003", "BD-WIN-001", "BD-WIN-002", "BD-CTL-001")
def earliest_branch(d: Draft) -> None:
    d.replace_group(2, make_group(2, plans(2, branch_tick=80)))
