"""Defects and limits of outcomes that a group cannot have: copies of each other, and exchanged ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pyarrow as pa
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.cases.tracks import COUNTS
from tests.validator.engine.rules.draft import Draft

Row = dict[str, object]


def like_nominal(d: Draft, copies: Callable[[Row], bool]) -> None:
    """Give observations of interventions the values of their nominal's at the same tick."""
    for shard in d.tables.values():
        record = {row["rollout_id"]: row for row in shard["rollouts"].to_pylist()}
        rows = shard["observations"].to_pylist()
        values = {(row["rollout_id"], row["tick"]): row for row in rows}
        for i, row in enumerate(rows):
            attempt = record[row["rollout_id"]]
            if attempt["role"] == "intervention" and copies({**attempt, **row}):
                own = {"rollout_id": row["rollout_id"]}
                rows[i] = {**values[attempt["nominal_rollout_id"], row["tick"]], **own}
        shard["observations"] = pa.Table.from_pylist(rows, shard["observations"].schema)


def give_outcome(d: Draft, action_key: str, other: str, *groups: str, first_tick: int = 0) -> None:
    """Give attempts of an action the observations of another action's, from a tick on."""
    for group_id in groups:
        for shard in d.tables.values():
            rows = shard["observations"].to_pylist()
            own, named = (f"{group_id}.{key}.a1" for key in (action_key, other))
            there = {row["tick"]: row for row in rows if row["rollout_id"] == named and row["tick"] >= first_tick}
            changed = [
                {**there.get(row["tick"], row), "rollout_id": own} if row["rollout_id"] == own else row for row in rows
            ]
            shard["observations"] = pa.Table.from_pylist(changed, shard["observations"].schema)


def exchange_outcomes(d: Draft, one: str, other: str, group_id: str) -> None:
    """Give attempts of two actions of a group the observations of each other."""
    ids = [f"{group_id}.{key}.a1" for key in (one, other)]
    new = {ids[0]: ids[1], ids[1]: ids[0]}
    for shard in d.tables.values():
        rows = [{**row, "rollout_id": new.get(row["rollout_id"], row["rollout_id"])}
                for row in shard["observations"].to_pylist()]  # fmt: skip
        shard["observations"] = pa.Table.from_pylist(rows, shard["observations"].schema)


# BD-GRP-009


@mutant("BD-GRP-009", base="bare", at={"group_id": "g0"})
def brake_that_does_nothing_in_one_group(d: Draft) -> None:
    like_nominal(d, lambda row: row["action_key"] == "brake_1.00" and row["group_id"] == "g0")


@mutant("BD-GRP-009", base="bare", at={"group_id": "g1"})
def steering_that_does_nothing_in_one_group(d: Draft) -> None:
    like_nominal(d, lambda row: row["action_key"] == "steer_left_0.10" and row["group_id"] == "g1")


@mutant("BD-GRP-009", base="bare", at={"group_id": "g0"})
def outcome_of_another_steering(d: Draft) -> None:
    give_outcome(d, "steer_left_0.05", "steer_left_0.10", "g0")


@mutant("BD-GRP-009", base="bare", at={"group_id": "g1"})
def outcome_of_another_braking_after_the_branch(d: Draft) -> None:
    give_outcome(d, "brake_0.50", "brake_1.00", "g1", first_tick=BRANCH_TICK + 5)


@boundary("BD-GRP-009", base="bare")
def outcomes_that_part_at_the_last_observation(d: Draft) -> None:
    """Two steerings at once in one place are no copy of each other."""
    ids = ["g0.steer_left_0.05.a1", "g0.steer_left_0.10.a1"]
    last = d.take("observations", rollout_id=ids[0], tick=BRANCH_TICK + 50)
    give_outcome(d, "steer_left_0.05", "steer_left_0.10", "g0")
    for name in ("x_m", "y_m", "yaw_rad"):
        d.set("observations", name, last[name][0].as_py(), rollout_id=ids[0], tick=BRANCH_TICK + 50)
    d.reroute(ids[0])


# BD-GRP-010: of attempts whose contacts nobody knows, whose way back to the route says nothing of their steering.


def _exchange_steering(d: Draft, magnitude: str) -> None:
    d.set("rollouts", COUNTS, None, group_id="g0")
    exchange_outcomes(d, f"steer_left_{magnitude}", f"steer_right_{magnitude}", "g0")


@mutant("BD-GRP-010", base="bare", at={"group_id": "g0"})
def outcomes_of_steering_exchanged(d: Draft) -> None:
    _exchange_steering(d, "0.10")


@boundary("BD-GRP-010", base="bare")
def outcomes_of_steerings_that_hardly_differ_exchanged(d: Draft) -> None:
    d.set("rollouts", COUNTS, None, group_id="g0")
    exchange_outcomes(d, "steer_left_0.05", "steer_left_0.10", "g0")


@boundary("BD-RSP-001", "BD-GRP-010", base="bare")
def candidate_that_ends_hardly_on_the_other_side(d: Draft) -> None:
    """What one candidate of one of three groups shows refutes no dataset."""
    attempt, end = "g0.steer_left_0.05.a1", {"tick": BRANCH_TICK + 50}
    give_outcome(d, "steer_left_0.05", "nominal", "g0")
    yaw = d.value("observations", "yaw_rad", rollout_id=attempt, **end)
    for column, share in (("x_m", np.sin(yaw)), ("y_m", -np.cos(yaw))):
        d.set("observations", column, lambda v, share=share: v + 0.25 * share, rollout_id=attempt, **end)
    d.reroute(attempt)


@mutant("BD-GRP-010", base="bare", at={"group_id": "g0"})
def outcomes_of_steering_to_one_side_exchanged(d: Draft) -> None:
    """Both still end on their side of the nominal, and each where the other one should."""
    d.set("rollouts", COUNTS, None, group_id="g0")
    exchange_outcomes(d, "steer_left_0.05", "steer_left_0.15", "g0")


# BD-GRP-011


def _exchange_driving(d: Draft, one: str, other: str, group_id: str = "g1") -> None:
    d.set("rollouts", COUNTS, None, group_id=group_id)
    exchange_outcomes(d, one, other, group_id)


@mutant("BD-GRP-011", base="bare", at={"group_id": "g1"})
def outcomes_of_braking_exchanged(d: Draft) -> None:
    _exchange_driving(d, "brake_0.30", "brake_1.00")


@mutant("BD-GRP-011", base="bare", at={"group_id": "g0"})
def outcomes_of_driving_and_braking_exchanged(d: Draft) -> None:
    _exchange_driving(d, "accelerate_0.80", "brake_0.30", "g0")


@mutant("BD-GRP-011", base="bare", at={"group_id": "g1"})
def outcomes_of_hard_braking_exchanged(d: Draft) -> None:
    """Wheels that lock hold less than those that roll, but not half of it."""
    _exchange_driving(d, "brake_0.50", "brake_1.00")


def _hold_a_share(d: Draft, share: float) -> None:
    """Let the harder of two brakes lose this share of the way and the speed that the softer one loses."""
    d.set("rollouts", COUNTS, None, group_id="g1")
    harder, softer = "g1.brake_1.00.a1", "g1.brake_0.50.a1"
    begin = next(row for row in d.take("observations", rollout_id=softer).to_pylist() if row["tick"] == BRANCH_TICK)
    for row in d.take("observations", rollout_id=softer).to_pylist():
        if row["tick"] <= BRANCH_TICK:
            continue
        way_m = begin["speed_mps"] * 0.05 * (row["tick"] - BRANCH_TICK)
        ahead = {"x_m": way_m * np.cos(begin["yaw_rad"]), "y_m": way_m * np.sin(begin["yaw_rad"]), "speed_mps": 0.0}
        kept = {name: (1 - share) * (begin[name] + more) + share * row[name] for name, more in ahead.items()}
        kept["accel_longitudinal_mps2"] = share * row["accel_longitudinal_mps2"]
        for name, value in kept.items():
            d.set("observations", name, value, rollout_id=harder, tick=row["tick"])
    d.reroute(harder)


@mutant("BD-GRP-011", base="bare", at={"group_id": "g1"})
def harder_brake_that_holds_little_more_than_half(d: Draft) -> None:
    _hold_a_share(d, 0.6)


@boundary("BD-GRP-011", base="bare")
def harder_brake_that_holds_four_fifths(d: Draft) -> None:
    """Its wheels may have locked."""
    _hold_a_share(d, 0.8)


@boundary("BD-GRP-011", base="bare")
def outcomes_of_hard_braking_of_a_vehicle_that_stands_at_once(d: Draft) -> None:
    """Both have lost all that they had."""
    _exchange_driving(d, "brake_0.50", "brake_1.00")
    attempts = d.take("rollouts", group_id="g1")["rollout_id"].to_pylist()
    d.set("observations", "speed_mps", 0.5, rollout_id=attempts, tick=BRANCH_TICK + 5)


@boundary("BD-GRP-011", base="bare")
def outcomes_of_a_vehicle_that_hardly_drives_exchanged(d: Draft) -> None:
    """From a standstill it may roll back."""
    _exchange_driving(d, "brake_0.30", "brake_1.00")
    attempts = d.take("rollouts", group_id="g1")["rollout_id"].to_pylist()
    d.set("observations", "speed_mps", 0.5, rollout_id=attempts, tick=BRANCH_TICK)


@boundary("BD-GRP-011", base="bare")
def outcomes_of_braking_exchanged_where_contacts_count(d: Draft) -> None:
    """Nobody knows when, and what is pushed comes further."""
    _exchange_driving(d, "brake_0.30", "brake_1.00")
    for action_key in ("brake_0.30", "brake_1.00"):
        d.set("rollouts", COUNTS[0], 1, rollout_id=f"g1.{action_key}.a1")
