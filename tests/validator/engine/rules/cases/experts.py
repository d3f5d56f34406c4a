"""Defects and limits of what is recorded beside an intervention: the expert that it overrides, and others' outcomes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pyarrow as pa
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import BRAKE, boundary, mutant
from tests.validator.engine.rules.draft import Draft

Row = dict[str, object]


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


# BD-RSP-010


def _override(d: Draft, expert: Callable[[Row, Row], Row]) -> None:
    """Let the expert command something else while it is overridden, and let policies follow it.

    `expert` gives its commands by a row and by the first active row of the same attempt.
    """
    policies = {policy["key"]: policy for policy in d.descriptor["action_bank"]["policies"]}
    for shard in d.tables.values():
        keys = {row["rollout_id"]: row["action_key"] for row in shard["rollouts"].to_pylist()}
        rows, first = shard["controls"].to_pylist(), dict[str, Row]()
        for row in rows:
            if row["active"]:
                command = expert(row, first.setdefault(row["rollout_id"], dict(row)))
                for actuator, value in command.items():
                    rule = policies[keys[row["rollout_id"]]][actuator]
                    row[f"expert_{actuator}"] = value
                    if rule["rule"] in ("online_expert", "floor"):
                        demanded = max(value, np.float32(rule.get("value") or -1))
                        row[f"intended_{actuator}"] = row[f"applied_{actuator}"] = float(demanded)
        shard["controls"] = pa.Table.from_pylist(rows, shard["controls"].schema)


def _commands(row: Row, kind: str) -> Row:
    return {actuator: row[f"{kind}_{actuator}"] for actuator in ("steer", "throttle", "brake")}


@mutant("BD-RSP-010", base="bare", at={"table": "controls", "column": "expert_steer"}, findings=2)
def expert_that_stops_while_it_is_overridden(d: Draft) -> None:
    _override(d, lambda _, first: _commands(first, "expert"))


@mutant("BD-RSP-010", base="bare", at={"table": "controls", "column": "expert_throttle"}, findings=2)
def expert_of_the_nominal(d: Draft) -> None:
    _override(d, lambda row, _: _commands(row, "nominal"))


@mutant("BD-RSP-010", base="bare", at={"table": "controls", "column": "expert_steer"}, findings=2)
def expert_that_is_what_was_applied(d: Draft) -> None:
    _override(d, lambda row, _: _commands(row, "applied"))


@boundary("BD-RSP-010", base="bare")
def expert_that_decides_once_a_second(d: Draft) -> None:
    """And holds its command between."""
    held: dict[tuple[str, int], Row] = {}
    _override(
        d,
        lambda row, _: held.setdefault((str(row["rollout_id"]), int(str(row["tick"])) // 20), _commands(row, "expert")),
    )


@boundary("BD-RSP-010", base="bare", status="skipped")
def log_that_goes_on(d: Draft) -> None:
    """A log commands what the nominal did, wherever the vehicle is."""
    d.descriptor["driver"] = {"kind": "log"}
    d.descriptor["unrecorded"] = [
        f"observations.{name}"
        for name in ("target_speed_mps", "vehicle_hazard", "pedestrian_hazard", "traffic_light_hazard")
    ]
    d.set("observations", tuple(name.partition(".")[2] for name in d.descriptor["unrecorded"]), None)
    _override(d, lambda row, _: _commands(row, "nominal"))


# BD-GRP-009


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
    d.set("rollouts", "result_num_static_collisions", None, group_id="g0")
    exchange_outcomes(d, f"steer_left_{magnitude}", f"steer_right_{magnitude}", "g0")


@mutant("BD-GRP-010", base="bare", at={"group_id": "g0"})
def outcomes_of_steering_exchanged(d: Draft) -> None:
    _exchange_steering(d, "0.10")


@boundary("BD-RSP-001", "BD-GRP-010", base="bare")
def outcomes_of_a_steering_that_is_hardly_one_exchanged(d: Draft) -> None:
    """What two candidates of one of three groups show refutes no dataset."""
    _exchange_steering(d, "0.05")


# BD-MOT-006

ON_A_BEND = "g1.steer_left_0.10.a1"


def _motion_of(column: str) -> dict[str, str]:
    return {"table": "observations", "column": column, "rollout_id": BRAKE}


@mutant("BD-MOT-006", at={**_motion_of("yaw_rate_radps"), "rollout_id": ON_A_BEND}, base="bare")
def yaw_rate_of_the_other_sense_in_an_attempt(d: Draft) -> None:
    """And so small that no single turn refutes it."""
    d.set("observations", "yaw_rate_radps", lambda rate: -0.2 * rate, rollout_id=ON_A_BEND)


@mutant("BD-MOT-006", at=_motion_of("accel_longitudinal_mps2"), base="bare")
def attempt_that_accelerates_for_nobody(d: Draft) -> None:
    d.set("observations", "accel_longitudinal_mps2", 0.0, rollout_id=BRAKE)


@boundary("BD-MOT-006", base="bare")
def accelerations_of_a_third_of_the_speeds(d: Draft) -> None:
    d.set("observations", ("accel_longitudinal_mps2", "accel_lateral_mps2"), lambda a: a / 3, rollout_id=BRAKE)
