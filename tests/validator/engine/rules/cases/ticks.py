"""Defects and limits of ticks and of the branch among them."""

from __future__ import annotations

import numpy as np
from tests.synthetic import make_group, plans
from tests.validator.engine.rules.case import (
    BOTH,
    BRAKE,
    FURTHER,
    NOMINAL,
    REPLAY,
    SHARD_0,
    boundary,
    mutant,
)
from tests.validator.engine.rules.draft import Draft

BRANCH_COLUMNS = (
    "branch_tick", "branch_frame", "trigger_definition", "trigger_rollout_id", "trigger_tick", "trigger_signal",
    "trigger_value", "trigger_threshold", "trigger_confidence",
)  # fmt: skip


LAST_TICK = 200


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


# Several places: what violates a rule is counted


@mutant("BD-TIC-001", at={"rollout_id": FURTHER, "tick": 11}, findings=2, lost=2)
def ticks_missing_in_two_attempts(d: Draft) -> None:
    for rollout_id in BOTH:
        d.drop("controls", rollout_id=rollout_id, tick=10)
        d.recount(rollout_id)
