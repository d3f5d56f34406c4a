"""Defects and limits of what interventions do, over the whole dataset."""

from __future__ import annotations

import math
from collections.abc import Callable

import pyarrow as pa
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import NOMINAL, REPLAY, boundary, mutant
from tests.validator.engine.rules.draft import Draft

Row = dict[str, object]


def _like_nominal(d: Draft, copies: Callable[[Row], bool]) -> None:
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


# BD-RSP-001


_LATERAL = (
    "y_m", "yaw_rad", "accel_lateral_mps2", "yaw_rate_radps", "route_offset_m", "route_heading_error_rad",
    "target_point_1_y_m", "target_point_2_y_m",
)  # fmt: skip


def _mirror(d: Draft, **where: object) -> None:
    """Turn the world left to right, and leave the steering command as it is."""
    ids = d.take("rollouts", **where)["rollout_id"].to_pylist()
    d.set("observations", _LATERAL, lambda value: -value, rollout_id=ids)
    d.set("rollouts", "route_y_m", lambda ys: [-y for y in ys], rollout_id=ids)


@mutant("BD-RSP-001", base="bare", at={"column": "applied_steer"})
def mirrored_world(d: Draft) -> None:
    _mirror(d)


@boundary("BD-RSP-001", base="bare")
def group_of_a_mirrored_world(d: Draft) -> None:
    """What one of three groups shows refutes nothing."""
    _mirror(d, group_id="g0")


# BD-RSP-002


@mutant("BD-RSP-002", base="bare", at={"action_key": "brake_1.00"})
def command_that_does_nothing(d: Draft) -> None:
    _like_nominal(d, lambda row: row["action_key"] == "brake_1.00")


@mutant(
    "BD-RSP-002", base="bare", at={"action_key": "accelerate_0.30"}, findings=11
)  # one steers like the nominal in a curve
def commands_are_ignored(d: Draft) -> None:
    """All but one: in a curve, the nominal steers like `steer_right_0.05`."""
    _like_nominal(d, lambda row: True)


@boundary("BD-RSP-002", "BD-GRP-009", base="bare")
def throttle_that_does_nothing_in_two_of_three_groups(d: Draft) -> None:
    """A vehicle at its top speed has no use for more throttle."""
    _like_nominal(d, lambda row: row["action_key"] == "accelerate_0.80" and row["group_id"] != "g0")


def _as(d: Draft, action_key: str, other: str, *groups: str) -> None:
    """Give attempts of an action the observations of another action's."""
    for group_id in groups:
        for shard in d.tables.values():
            rows = shard["observations"].to_pylist()
            own, named = (f"{group_id}.{key}.a1" for key in (action_key, other))
            there = {row["tick"]: row for row in rows if row["rollout_id"] == named}
            changed = [{**there[row["tick"]], "rollout_id": own} if row["rollout_id"] == own else row for row in rows]
            shard["observations"] = pa.Table.from_pylist(changed, shard["observations"].schema)


@mutant("BD-RSP-002", base="bare", at={"action_key": "steer_left_0.10"})
def two_actions_with_one_future(d: Draft) -> None:
    _as(d, "steer_left_0.05", "steer_left_0.10", "g0", "g1", "g2")


@boundary("BD-RSP-002", base="bare")
def two_actions_with_one_future_in_two_of_three_groups(d: Draft) -> None:
    _as(d, "steer_left_0.05", "steer_left_0.10", "g0", "g1")


# BD-GRP-009


@mutant("BD-GRP-009", base="bare", at={"group_id": "g0"})
def brake_that_does_nothing_in_one_group(d: Draft) -> None:
    _like_nominal(d, lambda row: row["action_key"] == "brake_1.00" and row["group_id"] == "g0")


@mutant("BD-GRP-009", base="bare", at={"group_id": "g1"})
def steering_that_does_nothing_in_one_group(d: Draft) -> None:
    _like_nominal(d, lambda row: row["action_key"] == "steer_left_0.10" and row["group_id"] == "g1")


# BD-RSP-003, BD-RSP-004


@boundary("BD-RSP-003", "BD-RSP-004", base="bare")
def responses_at_the_first_observation_after_the_branch(d: Draft) -> None:
    _like_nominal(d, lambda row: int(str(row["tick"])) <= BRANCH_TICK)


@mutant("BD-RSP-003", base="bare", at={"table": "observations"})
def observation_after_the_control(d: Draft) -> None:
    _like_nominal(d, lambda row: int(str(row["tick"])) < BRANCH_TICK)


@mutant("BD-RSP-003", base="bare", at={"table": "observations"})
def acceleration_of_the_control_to_come(d: Draft) -> None:
    """Braking alone shows in it, which is half of the actions."""
    _like_nominal(d, lambda row: int(str(row["tick"])) <= BRANCH_TICK)
    for key in ("brake_0.30", "brake_0.50", "brake_1.00"):
        ids = [f"g{group}.{key}.a1" for group in range(3)]
        d.set("observations", "accel_longitudinal_mps2", lambda v: v - 4.0, rollout_id=ids, tick=BRANCH_TICK)


def _anticipate(d: Draft, share: float) -> None:
    """Let a share of the effect on the acceleration of the next observation show at the branch."""
    for shard in d.tables.values():
        record = {row["rollout_id"]: row for row in shard["rollouts"].to_pylist()}
        rows = shard["observations"].to_pylist()
        at = {(row["rollout_id"], row["tick"]): row["accel_longitudinal_mps2"] for row in rows}
        for row in rows:
            nominal = record[row["rollout_id"]]["nominal_rollout_id"]
            if row["tick"] == BRANCH_TICK and nominal is not None:
                effect = at[row["rollout_id"], BRANCH_TICK + 5] - at[nominal, BRANCH_TICK + 5]
                row["accel_longitudinal_mps2"] = at[nominal, BRANCH_TICK] + share * effect
        shard["observations"] = pa.Table.from_pylist(rows, shard["observations"].schema)


@mutant("BD-RSP-003", base="bare", at={"column": "accel_longitudinal_mps2"})
def acceleration_of_the_control_to_come_under_noise(d: Draft) -> None:
    _anticipate(d, 0.6)


@boundary("BD-RSP-003", base="bare")
def acceleration_that_noise_changes_a_little(d: Draft) -> None:
    _anticipate(d, 0.4)


@boundary("BD-RSP-003", base="bare")
def acceleration_that_differs_in_two_of_three_groups(d: Draft) -> None:
    _like_nominal(d, lambda row: int(str(row["tick"])) <= BRANCH_TICK)
    ids = ["g0.brake_1.00.a1", "g1.brake_1.00.a1"]
    d.set("observations", "accel_longitudinal_mps2", lambda v: v - 4.0, rollout_id=ids, tick=BRANCH_TICK)


@mutant("BD-RSP-004", base="bare", at={"table": "observations"})
def observation_a_stride_late(d: Draft) -> None:
    _like_nominal(d, lambda row: int(str(row["tick"])) <= BRANCH_TICK + 5)


# BD-RSP-005


@mutant("BD-RSP-005", base="bare", at={"group_id": "g9"})
def group_under_two_names(d: Draft) -> None:
    for row in d.take("rollouts", group_id="g0").to_pylist():
        renamed = {
            name: f"g9{value[2:]}"
            for name in ("nominal_rollout_id", "trigger_rollout_id")
            if (value := row[name]) is not None
        }
        d.copy_attempt(row["rollout_id"], f"g9{row['rollout_id'][2:]}", group_id="g9", **renamed)


@boundary("BD-RSP-005", base="bare")
def replay_that_repeats_its_nominal(d: Draft) -> None:
    """Replays of a world without noise are equal to their nominal: that is what they are for."""
    for shard in d.tables.values():
        rows = shard["observations"].to_pylist()
        nominal = {row["tick"]: row for row in rows if row["rollout_id"] == NOMINAL}
        for i, row in enumerate(rows):
            if row["rollout_id"] == REPLAY:
                rows[i] = {**nominal[row["tick"]], "rollout_id": REPLAY}
        shard["observations"] = pa.Table.from_pylist(rows, shard["observations"].schema)


# BD-RSP-006


@mutant("BD-RSP-006", base="bare", at={"table": "observations"}, findings=2)
def speed_in_another_unit(d: Draft) -> None:
    """These vehicles are slow; of faster ones, nearly all fail where km/h are taken for m/s."""
    kinds = ("vehicle", "pedestrian", "static")
    d.set("rollouts", tuple(f"result_num_{kind}_collisions" for kind in kinds), 0)
    d.set("observations", "speed_mps", lambda speed: 8 * speed)


@boundary("BD-RSP-006", "BD-RSP-007", base="bare")
def speedometer_that_shows_too_much(d: Draft) -> None:
    d.set("observations", "speed_mps", lambda speed: 1.04 * speed)


# BD-RSP-007


@mutant("BD-RSP-007", base="bare", at={"column": "speed_mps"})
def clock_that_is_a_tenth_slower(d: Draft) -> None:
    d.set("observations", "speed_mps", lambda speed: speed / 1.1)


@mutant("BD-RSP-007", base="bare", at={"column": "accel_longitudinal_mps2"})
def accelerations_in_g(d: Draft) -> None:
    d.set("observations", "accel_longitudinal_mps2", lambda value: value / 9.81)


@mutant("BD-RSP-007", base="bare", at={"column": "accel_lateral_mps2"})
def accelerations_positive_to_the_right(d: Draft) -> None:
    d.set("observations", "accel_lateral_mps2", lambda value: -value)


@mutant("BD-RSP-007", base="bare", at={"column": "yaw_rate_radps"})
def yaw_rate_of_the_other_sense(d: Draft) -> None:
    """And so small that no single turn refutes it."""
    d.set("observations", "yaw_rate_radps", lambda value: -0.2 * value)


@mutant("BD-RSP-007", base="bare", at={"column": "yaw_rad"})
def compass_that_is_five_degrees_off(d: Draft) -> None:
    bias = math.radians(5)
    d.set("observations", "yaw_rad", lambda yaw: math.remainder(yaw + bias, 2 * math.pi))
    d.set("observations", "route_heading_error_rad", lambda yaw: math.remainder(yaw + bias, 2 * math.pi))
    _turn_targets(d, -bias)


def _turn_targets(d: Draft, angle: float) -> None:
    cos, sin = math.cos(angle), math.sin(angle)
    for shard in d.tables.values():
        rows = shard["observations"].to_pylist()
        for row in rows:
            for number in (1, 2):
                x, y = (row[f"target_point_{number}_{axis}_m"] for axis in ("x", "y"))
                row[f"target_point_{number}_x_m"] = cos * x - sin * y
                row[f"target_point_{number}_y_m"] = sin * x + cos * y
        shard["observations"] = pa.Table.from_pylist(rows, shard["observations"].schema)


@mutant("BD-RSP-007", base="full", at={"table": "actors", "column": "yaw_rad"})
def actors_with_yaw_clockwise(d: Draft) -> None:
    d.set("actors", "yaw_rad", lambda yaw: -yaw)
    for rollout_id in d.take("rollouts")["rollout_id"].to_pylist():
        collided = d.value("rollouts", "result_num_vehicle_collisions", rollout_id=rollout_id)
        seen = d.take("evidence", rollout_id=rollout_id)["collision"].to_pylist()
        d.refresh_evidence(rollout_id)
        _restore(d, rollout_id, collided, seen)


def _restore(d: Draft, rollout_id: str, collided: int, seen: list[bool]) -> None:
    """Contacts are what the simulator saw, also where boxes lie otherwise."""
    values = iter(seen)
    d.set("evidence", "collision", lambda _: next(values), rollout_id=rollout_id)
    d.set("rollouts", "result_num_vehicle_collisions", collided, rollout_id=rollout_id)
