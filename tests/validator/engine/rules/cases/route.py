"""Defects and limits of progress, offset, heading error and target points on a route."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import (
    ACCELERATE,
    BOTH,
    BRAKE,
    FURTHER,
    NOMINAL,
    boundary,
    mutant,
)
from tests.validator.engine.rules.cases.tracks import observed_at
from tests.validator.engine.rules.draft import Draft

from branchdrive.testing.drive import Array, on_grid

MOTION = ("speed_mps", "accel_longitudinal_mps2", "accel_lateral_mps2", "yaw_rate_radps")


TARGETS = tuple(f"target_point_{number}_{axis}_m" for number in (1, 2) for axis in ("x", "y"))


# BD-RTE-001


@mutant("BD-RTE-001", at=observed_at("route_progress_m", BRANCH_TICK))
def progress_of_the_front_bumper(d: Draft) -> None:
    d.set("observations", "route_progress_m", lambda v: v + 2.25, rollout_id=BRAKE, tick=BRANCH_TICK)


@mutant("BD-RTE-001", at=observed_at("route_progress_m", BRANCH_TICK - 80))
def offset_positive_to_the_right(d: Draft) -> None:
    d.set("observations", "route_offset_m", lambda v: -v, rollout_id=BRAKE)


@mutant("BD-RTE-001", at=observed_at("route_progress_m", BRANCH_TICK + 50))
def heading_error_of_the_route(d: Draft) -> None:
    d.set("observations", "route_heading_error_rad", lambda v: v + 0.002, rollout_id=BRAKE, tick=BRANCH_TICK + 50)


@boundary("BD-RTE-001", "BD-RTE-002")
def route_state_within_the_tolerance(d: Draft) -> None:
    d.set("observations", "route_progress_m", lambda v: v + 0.0009, rollout_id=BRAKE)
    d.set("observations", "route_offset_m", lambda v: v - 0.0009, rollout_id=BRAKE)
    d.set("observations", "route_heading_error_rad", lambda v: v + 0.0009, rollout_id=BRAKE)
    d.set("observations", "route_progress_m", 0.0, rollout_id=BRAKE, tick=BRANCH_TICK + 55)


# BD-RTE-002


@mutant("BD-RTE-002", at=observed_at("target_point_1_x_m", BRANCH_TICK))
def target_points_in_the_wrong_order(d: Draft) -> None:
    d.set("observations", TARGETS[0], lambda v: v + 12.0, rollout_id=BRAKE, tick=BRANCH_TICK)


@mutant("BD-RTE-002", at=observed_at("target_point_1_x_m", BRANCH_TICK - 80))
def target_points_in_the_world_frame(d: Draft) -> None:
    for axis in ("x", "y"):
        column = f"target_point_2_{axis}_m"
        own = iter(d.take("observations", rollout_id="g0.brake_0.30.a1")[f"{axis}_m"].to_pylist())
        d.set("observations", column, lambda v, own=own: v + next(own), rollout_id=BRAKE)


@mutant("BD-RTE-002", at=observed_at("target_point_1_x_m", BRANCH_TICK + 50))
def target_point_behind_the_ego(d: Draft) -> None:
    d.set("observations", TARGETS[0], -3.0, rollout_id=BRAKE, tick=BRANCH_TICK + 50)
    d.set("observations", TARGETS[1], 0.0, rollout_id=BRAKE, tick=BRANCH_TICK + 50)


@boundary("BD-RTE-002")
def target_points_at_the_end_of_the_route(d: Draft) -> None:
    for rollout_id in d.take("rollouts", group_id="g0")["rollout_id"].to_pylist():
        rows, route = d.take("observations", rollout_id=rollout_id), d.take("rollouts", rollout_id=rollout_id)
        dx, dy = (route[f"route_{axis}_m"][0].as_py()[-1] - rows[f"{axis}_m"].to_numpy() for axis in ("x", "y"))
        yaw = rows["yaw_rad"].to_numpy().astype(float)
        ahead, left = on_grid(np.cos(yaw) * dx + np.sin(yaw) * dy), on_grid(np.cos(yaw) * dy - np.sin(yaw) * dx)
        d.fill("observations", dict(zip(TARGETS, (ahead, left, ahead, left), strict=True)), rollout_id=rollout_id)


@mutant("BD-RTE-002", at=observed_at("target_point_1_x_m", BRANCH_TICK - 80))
def second_target_point_that_is_the_first(d: Draft) -> None:
    rows = d.take("observations", rollout_id=BRAKE)
    d.fill(
        "observations",
        {new: rows[old].to_numpy() for old, new in zip(TARGETS[:2], TARGETS[2:], strict=True)},
        rollout_id=BRAKE,
    )


# BD-RTE-004


def _look_ahead(d: Draft, further_m: float, ticks: Sequence[int], rollout_id: str = BRAKE) -> None:
    """Take target points of an attempt on its route along the x axis further ahead, at some ticks."""
    own = {"rollout_id": rollout_id, "tick": list(ticks)}
    rows = d.take("observations", **own)
    yaw = rows["yaw_rad"].to_numpy().astype(float)
    moved = {
        f"target_point_{number}_{axis}_m": rows[f"target_point_{number}_{axis}_m"].to_numpy() + further_m * share
        for number in (1, 2)
        for axis, share in (("x", np.cos(yaw)), ("y", -np.sin(yaw)))
    }
    d.fill("observations", moved, **own)


@mutant("BD-RTE-004", at=observed_at("target_point_1_x_m", BRANCH_TICK + 25))
def target_points_of_the_observation_before(d: Draft) -> None:
    _look_ahead(d, -3.0, [BRANCH_TICK + 25])


@mutant("BD-RTE-004", at=observed_at("target_point_1_x_m", BRANCH_TICK + 5))
def target_points_further_ahead_than_those_of_the_nominal(d: Draft) -> None:
    _look_ahead(d, 4.0, range(BRANCH_TICK + 5, BRANCH_TICK + 55, 5))


@boundary("BD-RTE-004", "BD-RTE-002")
def target_points_within_the_tolerance(d: Draft) -> None:
    _look_ahead(d, -0.0009, range(BRANCH_TICK + 5, BRANCH_TICK + 55, 10))


@boundary("BD-RTE-004", "BD-RTE-002")
def target_points_that_are_the_next_vertices(d: Draft) -> None:
    """They stay where they are until the ego has passed them."""
    for record in d.take("rollouts", group_id="g0").to_pylist():
        line = np.array([record["route_x_m"], record["route_y_m"]])
        arc = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(line, axis=1)))])
        rows = d.take("observations", rollout_id=record["rollout_id"])
        x, y, yaw, progress = (
            rows[name].to_numpy().astype(float) for name in ("x_m", "y_m", "yaw_rad", "route_progress_m")
        )
        first = np.searchsorted(arc, progress, "right")
        columns = {}
        for number in (1, 2):
            dx, dy = line[:, np.minimum(first + number - 1, len(arc) - 1)] - [x, y]
            columns[f"target_point_{number}_x_m"] = np.cos(yaw) * dx + np.sin(yaw) * dy
            columns[f"target_point_{number}_y_m"] = np.cos(yaw) * dy - np.sin(yaw) * dx
        d.fill("observations", columns, rollout_id=record["rollout_id"])


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


# Several places: what violates a rule is counted


@mutant("BD-RTE-001", at={"rollout_id": FURTHER, "tick": BRANCH_TICK}, findings=3, lost=2)
def progress_of_three_front_bumpers(d: Draft) -> None:
    attempts = [*BOTH, ACCELERATE]
    d.set("observations", "route_progress_m", lambda v: v + 2.25, rollout_id=attempts, tick=BRANCH_TICK)


# BD-RTE-005

IN_A_BEND = "g1.accelerate_0.80.a1"


def _bend(d: Draft, ticks: range) -> None:
    """Bend the route of g1 by 60 degrees to the left over 76 m and back by 20 beyond 115 m; command right at ticks."""
    nominal = d.take("observations", rollout_id="g1.nominal.a1", tick=0).to_pylist()[0]
    step_m, length_m = 2.0, 160.0
    along = np.arange(-4.0, length_m, step_m)
    heading = nominal["yaw_rad"] + np.deg2rad(
        60.0 * np.clip(along / 76.0, 0.0, 1.0) - np.where(along > 115.0, 20.0, 0.0)
    )
    x, y = (nominal[name] + step_m * (np.cumsum(turn(heading)) - 2 * turn(heading[0]))
            for name, turn in (("x_m", np.cos), ("y_m", np.sin)))  # fmt: skip
    for rollout_id in d.take("rollouts", group_id="g1")["rollout_id"].to_pylist():
        d.reroute(rollout_id, (x, y))
    d.set("observations", "command", "right", rollout_id=IN_A_BEND, tick=ticks)


@boundary("BD-RTE-005", base="bare")
def command_before_a_bend_to_the_other_side(d: Draft) -> None:
    """The junction lies behind it, 45 m beyond the last command."""
    _bend(d, range(0, 201, 5))


@mutant("BD-RTE-005", base="bare", at={"column": "command", "rollout_id": IN_A_BEND, "tick": 0})
def command_of_the_other_side(d: Draft) -> None:
    """The route turns by 47 degrees to the left meanwhile."""
    _bend(d, range(0, 160, 5))


@mutant("BD-RTE-005", base="bare", at={"column": "command", "rollout_id": IN_A_BEND, "tick": 15})
def command_of_the_other_side_far_from_its_junction(d: Draft) -> None:
    """The junction lies 54 m beyond the last command."""
    _bend(d, range(15, 165, 5))


@boundary("BD-RTE-005", base="bare")
def command_of_the_other_side_in_a_slight_bend(d: Draft) -> None:
    """At a fork both ways may bend to one side, by 43 degrees."""
    _bend(d, range(0, 145, 5))
