"""Defects and limits of what interventions do, over the whole dataset."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pyarrow as pa
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.cases.groups_outcomes import exchange_outcomes, like_nominal
from tests.validator.engine.rules.draft import Draft

from branchdrive.testing.drive import angle_on_grid, on_grid, route_columns

COUNTS = tuple(f"result_num_{kind}_collisions" for kind in ("vehicle", "pedestrian", "static"))


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


def _exchange_everywhere(d: Draft, one: str, other: str, *groups: str) -> None:
    d.set("rollouts", COUNTS, None)
    for group_id in groups:
        exchange_outcomes(d, one, other, group_id)


@mutant("BD-RSP-001", base="bare", at={"column": "applied_steer"})
def outcomes_of_steering_exchanged_in_all_groups(d: Draft) -> None:
    _exchange_everywhere(d, "steer_left_0.05", "steer_left_0.10", "g0", "g1", "g2")


@boundary("BD-RSP-001", base="bare")
def outcomes_of_steering_exchanged_in_two_of_three_groups(d: Draft) -> None:
    _exchange_everywhere(d, "steer_left_0.05", "steer_left_0.10", "g0", "g1")


@mutant("BD-RSP-001", base="bare", at={"column": "applied_throttle"})
def outcomes_of_hard_braking_exchanged_in_all_groups(d: Draft) -> None:
    _exchange_everywhere(d, "brake_0.50", "brake_1.00", "g0", "g1", "g2")


# BD-RSP-003, BD-RSP-004


@boundary("BD-RSP-003", "BD-RSP-004", base="bare")
def responses_at_the_first_observation_after_the_branch(d: Draft) -> None:
    like_nominal(d, lambda row: int(str(row["tick"])) <= BRANCH_TICK)


@mutant("BD-RSP-003", base="bare", at={"table": "observations"})
def observation_after_the_control(d: Draft) -> None:
    like_nominal(d, lambda row: int(str(row["tick"])) < BRANCH_TICK)


@mutant("BD-RSP-003", base="bare", at={"table": "observations"})
def acceleration_of_the_control_to_come(d: Draft) -> None:
    """Braking alone shows in it, which is half of the actions."""
    like_nominal(d, lambda row: int(str(row["tick"])) <= BRANCH_TICK)
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
    like_nominal(d, lambda row: int(str(row["tick"])) <= BRANCH_TICK)
    ids = ["g0.brake_1.00.a1", "g1.brake_1.00.a1"]
    d.set("observations", "accel_longitudinal_mps2", lambda v: v - 4.0, rollout_id=ids, tick=BRANCH_TICK)


@mutant("BD-RSP-004", base="bare", at={"table": "observations"})
def observation_a_stride_late(d: Draft) -> None:
    like_nominal(d, lambda row: int(str(row["tick"])) <= BRANCH_TICK + 5)


# BD-RSP-006


@mutant("BD-RSP-006", base="bare", at={"table": "observations"}, findings=2)
def speed_in_another_unit(d: Draft) -> None:
    """These vehicles are slow; of faster ones, nearly all fail where km/h are taken for m/s."""
    d.set("rollouts", COUNTS, 0)
    d.set("observations", "speed_mps", lambda speed: 8 * speed)


@mutant("BD-RSP-006", base="map", at={"table": "evidence"})
def lanes_of_another_map(d: Draft) -> None:
    d.set("evidence", "lane_id", "nowhere")


@mutant("BD-RSP-006", at={"table": "rollouts"})
def collisions_that_nothing_shows_in_any_attempt(d: Draft) -> None:
    d.set("evidence", "collision", False)
    d.set("rollouts", "result_num_pedestrian_collisions", 1)


@mutant("BD-RSP-006", base="bare", at={"table": "observations"}, findings=2)
def speed_in_another_unit_where_nobody_counts_contacts(d: Draft) -> None:
    d.set("rollouts", COUNTS, None)
    d.set("observations", "speed_mps", lambda speed: 8 * speed)


@mutant("BD-RSP-006", at={"table": "observations"})
def accelerations_that_contacts_hide(d: Draft) -> None:
    """Everything is in contact from the branch on."""
    d.set("evidence", "collision", False)
    d.set("evidence", "collision", True, tick=range(BRANCH_TICK + 5, 201))
    d.set("rollouts", COUNTS[:2], 0)
    d.set("rollouts", COUNTS[2], 1)
    d.set("observations", "accel_lateral_mps2", 16.5, tick=[BRANCH_TICK + 5, BRANCH_TICK + 20])


@boundary("BD-RSP-006", "BD-RSP-007", base="bare")
def speedometer_that_shows_too_much(d: Draft) -> None:
    d.set("observations", "speed_mps", lambda speed: 1.009 * speed)


# BD-RSP-007


@mutant("BD-RSP-007", base="bare", at={"column": "speed_mps"})
def ticks_that_are_three_percent_too_long(d: Draft) -> None:
    d.set("observations", "speed_mps", lambda speed: 0.97 * speed)


@mutant("BD-RSP-007", base="bare", at={"column": "x_m"})
def states_that_are_repeated_from_ten_hertz(d: Draft) -> None:
    """At odd ticks the vehicle is where it was a tick ago."""
    for rollout_id in d.take("rollouts")["rollout_id"].to_pylist():
        rows = d.take("observations", rollout_id=rollout_id)
        x, y, yaw, speed, tick = (rows[name].to_numpy() for name in ("x_m", "y_m", "yaw_rad", "speed_mps", "tick"))
        late_m = np.where(tick % 2, 0.05 * speed, 0.0)
        late = {"x_m": on_grid(x - late_m * np.cos(yaw)), "y_m": on_grid(y - late_m * np.sin(yaw))}
        d.fill("observations", late, rollout_id=rollout_id)
        d.reroute(rollout_id)


@mutant("BD-RSP-007", base="bare", at={"table": "controls", "column": "applied_steer"})
def steering_to_the_left_where_no_policy_acts(d: Draft) -> None:
    d.set("controls", ("expert_steer", "applied_steer"), lambda steer: -steer, active=False)
    d.set("controls", "nominal_steer", lambda steer: -steer, active=True)


@mutant("BD-RSP-007", base="bare", at={"table": "controls", "column": "applied_throttle"})
def pedals_exchanged_where_no_policy_acts(d: Draft) -> None:
    """The trigger found the brake under the name of the throttle."""
    for kind in ("expert", "applied"):
        d.swap("controls", f"{kind}_throttle", f"{kind}_brake", active=False)
    d.swap("controls", "nominal_throttle", "nominal_brake", active=True)
    for rollout_id in d.take("rollouts", role="intervention")["rollout_id"].to_pylist():
        if "steer" in rollout_id:
            for kind in ("intended", "applied"):
                d.swap("controls", f"{kind}_throttle", f"{kind}_brake", rollout_id=rollout_id, active=True)
    d.set("rollouts", "trigger_signal", "throttle_release")
    d.set("rollouts", "trigger_threshold", lambda value: 2 * value)


@mutant("BD-RSP-007", base="bare", at={"column": "speed_mps"})
def ticks_that_are_too_long_where_nobody_counts_contacts(d: Draft) -> None:
    d.set("rollouts", COUNTS[2], None)
    ticks_that_are_three_percent_too_long(d)


@mutant("BD-RSP-007", base="bare", at={"column": "accel_longitudinal_mps2"})
def accelerations_in_g(d: Draft) -> None:
    d.set("observations", "accel_longitudinal_mps2", lambda value: 0.102 * value)


@mutant("BD-RSP-007", base="bare", at={"column": "accel_lateral_mps2"})
def accelerations_positive_to_the_right(d: Draft) -> None:
    d.set("observations", "accel_lateral_mps2", lambda value: -value)


@mutant("BD-RSP-007", base="bare", at={"column": "yaw_rate_radps"})
def yaw_rate_of_the_other_sense(d: Draft) -> None:
    """And so small that no single turn refutes it."""
    d.set("observations", "yaw_rate_radps", lambda value: -0.2 * value)


@mutant("BD-RSP-007", base="bare", at={"column": "yaw_rate_radps"})
def yaw_rate_of_half_the_turn(d: Draft) -> None:
    d.set("observations", "yaw_rate_radps", lambda value: 0.55 * value)


@boundary("BD-RSP-007", base="bare")
def yaw_rate_of_two_thirds_of_the_turn(d: Draft) -> None:
    d.set("observations", "yaw_rate_radps", lambda value: 0.65 * value)


@mutant("BD-RSP-007", base="bare", at={"column": "yaw_rad"})
def compass_that_is_five_degrees_off(d: Draft) -> None:
    bias = float(angle_on_grid(math.radians(5)))
    for column in ("yaw_rad", "route_heading_error_rad"):
        d.set("observations", column, lambda yaw: float(angle_on_grid(yaw + bias)))
    _turn_targets(d, -bias)


def _turn_targets(d: Draft, angle: float) -> None:
    cos, sin = math.cos(angle), math.sin(angle)
    for shard in d.tables.values():
        rows = shard["observations"].to_pylist()
        for row in rows:
            for number in (1, 2):
                x, y = (row[f"target_point_{number}_{axis}_m"] for axis in ("x", "y"))
                row[f"target_point_{number}_x_m"] = float(on_grid(cos * x - sin * y))
                row[f"target_point_{number}_y_m"] = float(on_grid(sin * x + cos * y))
        shard["observations"] = pa.Table.from_pylist(rows, shard["observations"].schema)


@mutant("BD-RSP-007", base="full", at={"table": "actors", "column": "yaw_rad"})
def actors_with_yaw_clockwise(d: Draft) -> None:
    seen_again(d, lambda: d.set("actors", "yaw_rad", lambda yaw: -yaw))


@mutant("BD-RSP-007", base="full", at={"table": "actors", "column": "yaw_rad"})
def actors_that_crab(d: Draft) -> None:
    seen_again(d, lambda: d.set("actors", "yaw_rad", lambda yaw: float(angle_on_grid(yaw + math.radians(5)))))


@boundary("BD-RSP-007", base="full")
def actors_that_crab_a_little(d: Draft) -> None:
    seen_again(d, lambda: d.set("actors", "yaw_rad", lambda yaw: float(angle_on_grid(yaw + math.radians(2)))))


@mutant("BD-RSP-007", base="full", at={"table": "actors", "column": "vel_x_mps"})
def actors_with_a_clock_that_is_a_tenth_slower(d: Draft) -> None:
    """No way between two observations is wrong by as much as a metre."""
    seen_again(d, lambda: d.set("actors", ("vel_x_mps", "vel_y_mps"), lambda speed: 0.91 * speed))


@mutant("BD-RSP-007", base="bare", at={"table": "observations", "column": "x_m"})
def pose_of_the_rear_axle(d: Draft) -> None:
    """Where no axles are declared, it may be that of a body without them."""
    d.descriptor["vehicle"] = {"wheelbase_m": WHEELBASE_M}


@boundary("BD-RSP-007", base="bare")
def pose_between_the_axles(d: Draft) -> None:
    d.descriptor["vehicle"] = {"wheelbase_m": WHEELBASE_M}
    _ahead(d, 0.25 * WHEELBASE_M)


@mutant("BD-RSP-007", base="bare", at={"table": "observations", "column": "x_m"})
def pose_of_the_front_axle(d: Draft) -> None:
    d.descriptor["vehicle"] = {"wheelbase_m": WHEELBASE_M}
    _ahead(d, WHEELBASE_M)


WHEELBASE_M = 2.8
"""That of the car of the valid dataset, whose poses move as its rear axle does."""


def _ahead(d: Draft, by_m: float) -> None:
    """Record the poses of a point further ahead, and the route state there."""
    for shard in d.tables.values():
        lines = {
            row["rollout_id"]: tuple(np.array(row[f"route_{axis}_m"]) for axis in "xy")
            for row in shard["rollouts"].to_pylist()
        }
        rows = shard["observations"].to_pylist()
        for row in rows:
            yaw, (x, y) = row["yaw_rad"], lines[row["rollout_id"]]
            row["x_m"] = float(on_grid(row["x_m"] + by_m * math.cos(yaw)))
            row["y_m"] = float(on_grid(row["y_m"] + by_m * math.sin(yaw)))
            pose = (np.array([row[name]]) for name in ("x_m", "y_m", "yaw_rad"))
            row |= {name: values[0] for name, values in route_columns(*pose, (x, y)).items()}
        shard["observations"] = pa.Table.from_pylist(rows, shard["observations"].schema)


def seen_again(d: Draft, change: Callable[[], None]) -> None:
    """Change actors and compute their evidence again; contacts are what the simulator saw, also where boxes lie now."""
    change()
    for rollout_id in d.take("rollouts")["rollout_id"].to_pylist():
        counted, seen = (d.take(table, rollout_id=rollout_id) for table in ("rollouts", "evidence"))
        d.refresh_evidence(rollout_id)
        d.fill(
            "evidence", {"collision": seen["collision"].to_numpy(zero_copy_only=False)}, rollout_id=rollout_id
        )  # as the simulator saw
        for kind in ("vehicle", "pedestrian", "static"):
            column = f"result_num_{kind}_collisions"
            d.set("rollouts", column, counted[column][0].as_py(), rollout_id=rollout_id)


# BD-RSP-016: the car of the valid dataset turns its wheels by 0.6 rad and brakes with 6 m/s2.


def _declared(d: Draft, max_steer_rad: float, max_decel_mps2: float) -> None:
    d.descriptor["vehicle"] = {
        "wheelbase_m": WHEELBASE_M, "max_steer_rad": max_steer_rad, "max_decel_mps2": max_decel_mps2,
    }  # fmt: skip
    _ahead(d, 0.5 * WHEELBASE_M)


@mutant("BD-RSP-016", base="bare", at={"table": "controls", "column": "applied_steer"})
def vehicle_with_wheels_that_turn_further(d: Draft) -> None:
    _declared(d, 1.0, 6.0)


@mutant("BD-RSP-016", base="bare", at={"table": "controls", "column": "applied_brake"})
def vehicle_with_half_its_brakes(d: Draft) -> None:
    _declared(d, 0.6, 3.0)


@boundary("BD-RSP-016", base="bare")
def vehicle_that_drives(d: Draft) -> None:
    _declared(d, 0.6, 6.0)
