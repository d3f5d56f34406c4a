"""Defects and limits of what columns say of the world: route state, motion, tracks of actors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pyarrow as pa
from tests.synthetic import BRANCH_TICK, EGO_BOX_M, to_table
from tests.validator.engine.rules.case import BRAKE, NOMINAL, SHARD_0, boundary, mutant
from tests.validator.engine.rules.draft import Draft

from branchdrive.testing.drive import Array

COUNTS = tuple(f"result_num_{kind}_collisions" for kind in ("vehicle", "pedestrian", "static"))
MOTION = ("speed_mps", "accel_longitudinal_mps2", "accel_lateral_mps2", "yaw_rate_radps")
TARGETS = tuple(f"target_point_{number}_{axis}_m" for number in (1, 2) for axis in ("x", "y"))


def _observed(column: str, tick: int) -> dict[str, str | int]:
    return {"table": "observations", "column": column, "rollout_id": BRAKE, "tick": tick}


def _actor(column: str, tick: int, actor_id: int) -> dict[str, str | int]:
    return {"table": "actors", "column": column, "rollout_id": BRAKE, "tick": tick, "actor_id": actor_id}


def _refresh(d: Draft) -> None:
    """Evidence of the actors as they are now; nothing is touched that was not."""
    d.refresh_evidence(BRAKE)
    d.set("evidence", "collision", False, rollout_id=BRAKE)
    d.set("rollouts", COUNTS, 0, rollout_id=BRAKE)


# BD-RTE-001


@mutant("BD-RTE-001", at=_observed("route_progress_m", BRANCH_TICK))
def progress_of_the_front_bumper(d: Draft) -> None:
    d.set("observations", "route_progress_m", lambda v: v + 2.25, rollout_id=BRAKE, tick=BRANCH_TICK)


@mutant("BD-RTE-001", at=_observed("route_progress_m", BRANCH_TICK - 80))
def offset_positive_to_the_right(d: Draft) -> None:
    d.set("observations", "route_offset_m", lambda v: -v, rollout_id=BRAKE)


@mutant("BD-RTE-001", at=_observed("route_progress_m", BRANCH_TICK + 50))
def heading_error_of_the_route(d: Draft) -> None:
    d.set("observations", "route_heading_error_rad", lambda v: v + 0.002, rollout_id=BRAKE, tick=BRANCH_TICK + 50)


@boundary("BD-RTE-001", "BD-RTE-002")
def route_state_within_the_tolerance(d: Draft) -> None:
    d.set("observations", "route_progress_m", lambda v: v + 0.0009, rollout_id=BRAKE)
    d.set("observations", "route_offset_m", lambda v: v - 0.0009, rollout_id=BRAKE)
    d.set("observations", "route_heading_error_rad", lambda v: v + 0.0009, rollout_id=BRAKE)
    d.set("observations", "route_progress_m", 0.0, rollout_id=BRAKE, tick=BRANCH_TICK + 55)


# BD-RTE-002


@mutant("BD-RTE-002", at=_observed("target_point_1_x_m", BRANCH_TICK))
def target_points_in_the_wrong_order(d: Draft) -> None:
    d.set("observations", TARGETS[0], lambda v: v + 12.0, rollout_id=BRAKE, tick=BRANCH_TICK)


@mutant("BD-RTE-002", at=_observed("target_point_1_x_m", BRANCH_TICK - 80))
def target_points_in_the_world_frame(d: Draft) -> None:
    for axis in ("x", "y"):
        column = f"target_point_2_{axis}_m"
        own = iter(d.take("observations", rollout_id="g0.brake_0.30.a1")[f"{axis}_m"].to_pylist())
        d.set("observations", column, lambda v, own=own: v + next(own), rollout_id=BRAKE)


@mutant("BD-RTE-002", at=_observed("target_point_1_x_m", BRANCH_TICK + 50))
def target_point_behind_the_ego(d: Draft) -> None:
    d.set("observations", TARGETS[0], -3.0, rollout_id=BRAKE, tick=BRANCH_TICK + 50)
    d.set("observations", TARGETS[1], 0.0, rollout_id=BRAKE, tick=BRANCH_TICK + 50)


@boundary("BD-RTE-002")
def target_points_at_the_end_of_the_route(d: Draft) -> None:
    rows, route = d.take("observations", rollout_id=BRAKE), d.take("rollouts", rollout_id=BRAKE)
    dx, dy = (route[f"route_{axis}_m"][0].as_py()[-1] - rows[f"{axis}_m"].to_numpy() for axis in ("x", "y"))
    yaw = rows["yaw_rad"].to_numpy().astype(float)
    ahead, left = np.cos(yaw) * dx + np.sin(yaw) * dy, np.cos(yaw) * dy - np.sin(yaw) * dx
    d.fill("observations", dict(zip(TARGETS, (ahead, left, ahead, left), strict=True)), rollout_id=BRAKE)


# BD-RTE-003


def _reroute(d: Draft, change: Callable[[Array, Array], tuple[Array, Array]]) -> None:
    """Give the attempts of the first group another polyline, with the route state on it."""
    for record in d.take("rollouts", group_id="g0").to_pylist():
        d.reroute(record["rollout_id"], change(*(np.array(record[f"route_{axis}_m"]) for axis in "xy")))


@mutant("BD-RTE-003", base="bare", at={"column": "route_offset_m", "rollout_id": NOMINAL, "tick": BRANCH_TICK - 80})
def route_of_the_next_street(d: Draft) -> None:
    _reroute(d, lambda x, y: (x, y + 40))


@mutant("BD-RTE-003", base="bare", at={"column": "route_heading_error_rad", "rollout_id": NOMINAL})
def route_from_its_end_to_its_start(d: Draft) -> None:
    _reroute(d, lambda x, y: (x[::-1], y[::-1]))


@boundary("BD-RTE-003", base="bare")
def route_on_the_other_carriageway(d: Draft) -> None:
    _reroute(d, lambda x, y: (x, y - 29))


@boundary("BD-RTE-003", base="bare")
def nominal_that_hardly_drives(d: Draft) -> None:
    """At seven observations it is faster than a vehicle that stands, and so are its replays."""
    group = d.take("rollouts", group_id="g0")["rollout_id"].to_pylist()
    for column in ("x_m", "y_m", "yaw_rad"):
        d.set("observations", column, d.value("observations", column, rollout_id=NOMINAL, tick=0), rollout_id=group)
    d.set("observations", MOTION, 0.0, rollout_id=group)
    d.set("observations", "speed_mps", 0.5, rollout_id=group)
    d.set("observations", "speed_mps", 1.0, rollout_id=group, tick=range(BRANCH_TICK, BRANCH_TICK + 35, 5))
    _reroute(d, lambda x, y: (x[::-1], y[::-1]))


# BD-MOT


@mutant("BD-MOT-001", at=_observed("x_m", 5), base="bare")
def speed_in_kilometres_per_hour(d: Draft) -> None:
    d.set("observations", "speed_mps", lambda v: 3.6 * v, rollout_id=BRAKE)


@boundary("BD-MOT-001", base="bare")
def speed_at_the_bound(d: Draft) -> None:
    """Whatever the mean of the attempt says where nobody knows its contacts."""
    d.set("rollouts", COUNTS[2], None, rollout_id=BRAKE)
    d.set("observations", "speed_mps", lambda v: v + 4.0, rollout_id=BRAKE)


@mutant("BD-MOT-001", at=_observed("x_m", 5), base="bare")
def speed_in_kilometres_per_hour_where_nobody_counts_contacts(d: Draft) -> None:
    d.set("rollouts", COUNTS[2], None, rollout_id=BRAKE)
    d.set("observations", "speed_mps", lambda v: 3.6 * v, rollout_id=BRAKE)


def _speeding(d: Draft, ticks: range) -> None:
    """Speeds that break the displacement there and at the next observation."""
    d.set("observations", "speed_mps", lambda v: v + 30.0, rollout_id=BRAKE, tick=ticks)


@mutant("BD-MOT-001", at=_observed("x_m", 120), base="bare")
def speeds_that_no_contact_explains(d: Draft) -> None:
    d.set("rollouts", COUNTS[0], None, rollout_id=BRAKE)
    _speeding(d, range(120, 160, 5))


@boundary("BD-MOT-001", base="bare")
def speeds_that_a_contact_explains(d: Draft) -> None:
    d.set("rollouts", COUNTS[0], None, rollout_id=BRAKE)
    _speeding(d, range(120, 155, 5))


def _touch(d: Draft, rollout_id: str, *ticks: int) -> None:
    """Let an attempt touch something static."""
    d.set("evidence", "collision", True, rollout_id=rollout_id, tick=list(ticks))
    d.set("rollouts", COUNTS[2], 1, rollout_id=rollout_id)


@boundary("BD-MOT-001", "BD-MOT-003", "BD-MOT-004")
def speeds_that_are_wrong_within_two_seconds_of_a_contact(d: Draft) -> None:
    d.set("observations", "speed_mps", lambda v: v + 30.0, rollout_id=BRAKE, tick=range(20, 60, 5))
    d.refresh_evidence(BRAKE)
    _touch(d, BRAKE, 20)


@mutant("BD-MOT-002", at=_observed("yaw_rad", 150))
def yaw_rate_without_a_turn(d: Draft) -> None:
    d.set("observations", "yaw_rate_radps", 1.7, rollout_id=BRAKE, tick=[150, 155])


@boundary("BD-MOT-002")
def yaw_rate_of_a_swerve(d: Draft) -> None:
    d.set("observations", "yaw_rate_radps", 1.5, rollout_id=BRAKE, tick=150)


@mutant("BD-MOT-002", at=_observed("yaw_rad", 65))
def yaw_rate_that_is_wrong_two_seconds_after_a_contact(d: Draft) -> None:
    _touch(d, BRAKE, 20)
    d.set("observations", "yaw_rate_radps", 1.2, rollout_id=BRAKE, tick=[60, 65])


@boundary("BD-MOT-002")
def yaw_rate_that_is_wrong_two_seconds_from_a_contact_on(d: Draft) -> None:
    _touch(d, BRAKE, 20)
    d.set("observations", "yaw_rate_radps", 1.2, rollout_id=BRAKE, tick=[55, 60])


@mutant("BD-MOT-003", at=_observed("accel_longitudinal_mps2", 0))
def acceleration_of_the_tick_to_come(d: Draft) -> None:
    d.set("observations", "accel_longitudinal_mps2", 0.5, rollout_id=BRAKE, tick=0)


@mutant("BD-MOT-003", at=_observed("yaw_rate_radps", 0))
def yaw_rate_before_the_first_tick(d: Draft) -> None:
    d.set("observations", "yaw_rate_radps", 0.01, rollout_id=BRAKE, tick=0)


@mutant("BD-MOT-003", at=_observed("accel_lateral_mps2", 50))
def acceleration_without_a_turn(d: Draft) -> None:
    d.set("observations", "accel_lateral_mps2", -16.0, rollout_id=BRAKE, tick=50)


@mutant("BD-MOT-003", at=_observed("accel_longitudinal_mps2", 50))
def acceleration_without_a_change_of_speed(d: Draft) -> None:
    d.set("observations", "accel_longitudinal_mps2", 17.0, rollout_id=BRAKE, tick=50)


@boundary("BD-MOT-003")
def acceleration_of_an_emergency_stop(d: Draft) -> None:
    d.set("observations", "accel_longitudinal_mps2", -13.0, rollout_id=BRAKE, tick=50)


@mutant("BD-MOT-004", at={"table": "evidence", "column": "collision", "rollout_id": BRAKE, "tick": 0})
def drive_that_begins_in_contact(d: Draft) -> None:
    _touch(d, BRAKE, 0)


@mutant("BD-MOT-004", at={"table": "evidence", "column": "collision", "rollout_id": BRAKE, "tick": 25})
def history_in_contact(d: Draft) -> None:
    """Of its observations, those from the 65th tick on are judged but for the last."""
    _touch(d, BRAKE, 25)


@boundary("BD-MOT-004")
def first_half_of_a_history_in_contact(d: Draft) -> None:
    _touch(d, BRAKE, 5, 10, 15, 20)


def _touch_all_but(d: Draft, number: int) -> None:
    """Let all attempts but the last ones touch something static, once, after the branch."""
    d.set("evidence", "collision", False)
    d.set("rollouts", COUNTS, 0)
    for rollout_id in d.take("rollouts")["rollout_id"].to_pylist()[: -number or None]:
        _touch(d, rollout_id, 150)


@mutant("BD-MOT-005", at={"table": "evidence", "column": "collision"})
def contacts_in_all_attempts(d: Draft) -> None:
    _touch_all_but(d, 0)


@boundary("BD-MOT-005")
def contacts_in_eight_of_nine_attempts(d: Draft) -> None:
    _touch_all_but(d, 8)


# BD-ACT


@mutant("BD-ACT-001", at=_actor("actor_class", BRANCH_TICK, 3))
def cycle_that_becomes_a_vehicle(d: Draft) -> None:
    d.set("actors", "actor_class", "vehicle", rollout_id=BRAKE, actor_id=3, tick=range(BRANCH_TICK, 201))


@mutant("BD-ACT-001", at=_actor("height_m", BRANCH_TICK, 7))
def actor_that_grows(d: Draft) -> None:
    d.set("actors", "height_m", lambda v: v + 1, rollout_id=BRAKE, actor_id=7, tick=BRANCH_TICK)


@boundary("BD-ACT-001")
def actor_that_grows_outside_the_windows(d: Draft) -> None:
    d.set("actors", "height_m", lambda v: v + 1, rollout_id=BRAKE, actor_id=7, tick=BRANCH_TICK + 55)


@mutant("BD-ACT-002", at=_actor("x_m", BRANCH_TICK - 75, 99))
def ego_among_the_actors(d: Draft) -> None:
    rows = d.take("observations", rollout_id=BRAKE)
    count, speed, yaw = len(rows), rows["speed_mps"].to_numpy(), rows["yaw_rad"].to_numpy()
    box = dict(zip(("length_m", "width_m", "height_m"), np.tile(np.array(EGO_BOX_M)[:, None], count), strict=True))
    columns = {
        **{name: rows[name].to_pylist() for name in ("rollout_id", "tick", "x_m", "y_m", "yaw_rad")}, **box,
        "actor_id": [99] * count, "actor_class": ["vehicle"] * count,
        "vel_x_mps": speed * np.cos(yaw), "vel_y_mps": speed * np.sin(yaw),
    }  # fmt: skip
    d.append("actors", to_table("actors", columns), folder=SHARD_0)
    _refresh(d)
    d.set("rollouts", COUNTS[0], None, rollout_id=BRAKE)


@mutant("BD-ACT-002", at=_actor("x_m", BRANCH_TICK - 75, 99))
def ego_with_the_extents_of_a_data_sheet(d: Draft) -> None:
    ego_among_the_actors(d)
    d.set("actors", ("length_m", "width_m"), lambda v: v + 0.02, rollout_id=BRAKE, actor_id=99)
    d.set("actors", "x_m", lambda v: v + 0.2, rollout_id=BRAKE, actor_id=99)
    _refresh(d)
    d.set("rollouts", COUNTS[0], None, rollout_id=BRAKE)


@mutant("BD-ACT-002", at=_actor("actor_id", BRANCH_TICK - 75, 98))
def actor_under_two_ids(d: Draft) -> None:
    d.duplicate("actors", {"actor_id": 98}, rollout_id=BRAKE, actor_id=1)
    _refresh(d)


@boundary("BD-ACT-002", "BD-ACT-001", "BD-ACT-003")
def cars_of_one_make_in_any_order(d: Draft) -> None:
    for column, extent in zip(("length_m", "width_m", "height_m"), EGO_BOX_M, strict=True):
        d.set("actors", column, extent, rollout_id=BRAKE, actor_id=[1, 2])
    d.map_table("actors", lambda rows: rows.take(pa.array(np.arange(len(rows))[::-1])), folder=SHARD_0)
    _refresh(d)


@mutant("BD-ACT-003", at=_actor("actor_id", BRANCH_TICK, 1))
def actor_that_blinks(d: Draft) -> None:
    d.drop("actors", rollout_id=BRAKE, actor_id=1, tick=[BRANCH_TICK - 10, BRANCH_TICK - 5])
    _refresh(d)


@boundary("BD-ACT-003")
def actor_out_of_range_that_blinks(d: Draft) -> None:
    d.drop("actors", rollout_id=BRAKE, actor_id=7, tick=BRANCH_TICK - 75 + 5)
    _refresh(d)


def _stand(d: Draft, actor_id: int) -> None:
    """Let an actor stand where it is at the branch."""
    for column in ("x_m", "y_m"):
        d.set("actors", column, d.value("actors", column, rollout_id=BRAKE, actor_id=actor_id, tick=BRANCH_TICK),
              rollout_id=BRAKE, actor_id=actor_id)  # fmt: skip
    d.set("actors", ("vel_x_mps", "vel_y_mps"), 0.0, rollout_id=BRAKE, actor_id=actor_id)


@mutant("BD-ACT-003", at=_actor("actor_id", BRANCH_TICK + 25, 4))
def standing_actor_that_is_away_for_three_seconds(d: Draft) -> None:
    _stand(d, 4)
    d.drop("actors", rollout_id=BRAKE, actor_id=4, tick=range(BRANCH_TICK - 35, BRANCH_TICK + 25))
    _refresh(d)


@boundary("BD-ACT-003", "BD-ACT-005")
def actor_near_the_limit_of_the_range_that_is_away_for_three_seconds(d: Draft) -> None:
    x_m = d.value("observations", "x_m", rollout_id=BRAKE, tick=BRANCH_TICK)
    d.set("actors", "x_m", x_m, rollout_id=BRAKE, actor_id=7)
    d.set("actors", "y_m", 46.0, rollout_id=BRAKE, actor_id=7)
    d.drop("actors", rollout_id=BRAKE, actor_id=7, tick=range(BRANCH_TICK - 35, BRANCH_TICK + 25))
    _refresh(d)


def _another(d: Draft, away_m: float) -> None:
    """Let an oncoming vehicle leave, and give its id after two seconds to one that is as far from its way."""
    first, last = BRANCH_TICK - 75, BRANCH_TICK + 50
    d.drop("actors", rollout_id=BRAKE, actor_id=7, tick=range(first + 5, first + 45))
    d.set("actors", "y_m", lambda v: v + away_m, rollout_id=BRAKE, actor_id=7, tick=range(first + 45, last + 5))
    _refresh(d)


@mutant("BD-ACT-005", at=_actor("actor_id", BRANCH_TICK - 30, 7))
def id_of_somebody_who_left(d: Draft) -> None:
    _another(d, 20.0)


@boundary("BD-ACT-005")
def actor_that_moves_out_of_range(d: Draft) -> None:
    _another(d, 10.0)


@mutant("BD-ACT-004", at=_actor("vel_x_mps", BRANCH_TICK - 70, 2))
def actor_velocity_in_kilometres_per_hour(d: Draft) -> None:
    d.set("actors", ("vel_x_mps", "vel_y_mps"), lambda v: 3.6 * v, rollout_id=BRAKE, actor_id=2)
    _refresh(d)


@boundary("BD-ACT-004")
def actor_velocity_at_the_bound(d: Draft) -> None:
    """Of somebody who stands, whose steps say nothing of a speed."""
    d.set("actors", "vel_y_mps", lambda v: v + 3.9, rollout_id=BRAKE, actor_id=4)
    _refresh(d)
