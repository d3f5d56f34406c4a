"""Moving over: a driver reaches the offset it wants, smoothly, and only while it drives."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference_impl.world.ground import ADVISORY_MPS, NORTH, Ground, track

from branchdrive.contract.timing import TICK_S
from branchdrive_reference.town.lane import LANE_WIDTH_M
from branchdrive_reference.world.body import Body

each_side = pytest.mark.parametrize("goal_m", [LANE_WIDTH_M, -LANE_WIDTH_M])
LATERAL_MPS = Body.lateral_mps


def moving_over(goal_m: float, *, heading_rad: float = 0.0, ticks: int = 160) -> np.ndarray:
    """History of a driver that moves over; the ego is elsewhere."""
    ground = Ground([track(left_m=200.0), track(heading_rad)])
    row = ground.vehicle_at(-50.0, 1, goal_offset_m=goal_m)
    ground.drive(ticks)
    return ground.history[:, row]


@each_side
def test_the_goal_is_reached_and_kept(goal_m: float) -> None:
    body = moving_over(goal_m)
    assert body["y_m"][-1] == pytest.approx(goal_m, abs=1e-6)
    assert body["yaw_rad"][-1] == pytest.approx(0.0, abs=1e-3)
    assert body["speed_mps"].min() > 0.8 * ADVISORY_MPS


@each_side
def test_the_way_over_is_monotone_and_no_faster_than_wanted(goal_m: float) -> None:
    step_m = np.diff(moving_over(goal_m)["y_m"]) * np.sign(goal_m)
    assert step_m.min() > -1e-9
    assert step_m.max() <= LATERAL_MPS * TICK_S + 1e-9


@each_side
def test_velocity_is_the_motion(goal_m: float) -> None:
    body = moving_over(goal_m)
    for position, velocity in (("x_m", "vel_x_mps"), ("y_m", "vel_y_mps")):
        assert np.diff(body[position]) == pytest.approx(body[velocity][1:] * TICK_S, abs=1e-9)


@each_side
def test_the_heading_follows_the_motion(goal_m: float) -> None:
    """Within what the turning rate allows at the beginning and the end."""
    body = moving_over(goal_m)
    along = np.arctan2(body["vel_y_mps"], body["vel_x_mps"])
    steady = np.abs(body["y_m"] / goal_m - 0.5) < 0.25
    assert steady.sum() > 10
    assert body["yaw_rad"][steady] == pytest.approx(along[steady], abs=0.01)
    assert np.abs(np.diff(body["yaw_rad"])).max() < 0.1


def test_directions_do_not_depend_on_the_frame() -> None:
    east, north = moving_over(LANE_WIDTH_M), moving_over(LANE_WIDTH_M, heading_rad=NORTH)
    assert north["y_m"] == pytest.approx(east["x_m"], abs=1e-6)
    assert -north["x_m"] == pytest.approx(east["y_m"], abs=1e-6)


@each_side
def test_who_stands_does_not_move_sideways(goal_m: float) -> None:
    ground = Ground([track(left_m=200.0), track()])
    row = ground.vehicle_at(-50.0, 1, speed_mps=0.0, goal_offset_m=goal_m)
    ground.bodies["commanded_accel_mps2"][row] = 0.0
    ground.drive(60)
    body = ground.history[:, row]
    assert np.ptp(body["y_m"]) == 0.0
    assert np.ptp(body["yaw_rad"]) == 0.0
    assert body["offset_m"][-1] == 0.0


@each_side
def test_who_creeps_moves_over_no_steeper_than_it_can(goal_m: float) -> None:
    ground = Ground([track(left_m=200.0), track()])
    row = ground.vehicle_at(-50.0, 1, speed_mps=0.5, goal_offset_m=goal_m)
    ground.bodies["commanded_accel_mps2"][row] = 0.0
    ground.drive(60)
    body = ground.history[:, row]
    assert np.abs(np.diff(body["y_m"])).max() <= np.diff(body["x_m"]).max()
    assert np.abs(body["yaw_rad"]).max() < np.pi / 4
