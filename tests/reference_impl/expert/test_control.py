"""Steering, pedals and reference path of the expert."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.reference_impl.geometry.paths import ROAD
from tests.reference_impl.world.driving import Plane

from branchdrive.contract.timing import TICK_S
from branchdrive_reference.expert.control import PLAN, pedals, pursuit_curvature_1pm, reference_offset_m, steer_command
from branchdrive_reference.world.vehicle import MAX_BRAKE_MPS2, resistance_mps2


def plan(**fields: float) -> np.void:
    row = np.zeros(1, PLAN)
    for name, value in fields.items():
        row[name] = value
    return row[0]


def test_the_reference_path_leaves_holds_and_returns() -> None:
    shifted = plan(shift_m=2.4, begin_m=20.0, full_m=40.0, hold_m=60.0, end_m=80.0)
    offsets = [reference_offset_m(shifted, arc) for arc in (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 99.0)]
    assert offsets == pytest.approx([0.0, 0.0, 1.2, 2.4, 2.4, 2.4, 1.2, 0.0, 0.0])
    assert reference_offset_m(plan(), 50.0) == 0.0


def test_a_path_to_the_left_asks_for_left_steering() -> None:
    curvature = pursuit_curvature_1pm(plan(), ROAD, 0.0, -2.0, 0.0, 0.0, 8.0)
    assert curvature > 0
    assert steer_command(curvature) < 0
    assert steer_command(-curvature) == -steer_command(curvature)


@pytest.mark.parametrize("offset_m", [-3.0, 1.0, 3.0])
def test_pursuit_brings_the_vehicle_back_to_the_path(offset_m: float) -> None:
    plane = Plane(8.0)
    plane.bodies["y_m"][0] = offset_m
    for _ in range(160):
        ego = plane.bodies[0]
        x, y, yaw = float(ego["x_m"]), float(ego["y_m"]), float(ego["yaw_rad"])
        curvature = pursuit_curvature_1pm(plan(), ROAD, x, y, yaw, x, 8.0)
        throttle, brake = pedals(8.0 - float(ego["speed_mps"]), float(ego["speed_mps"]))
        plane.drive(1, steer_command(curvature), throttle, brake)
    assert abs(plane.bodies["y_m"][0]) < 0.1
    assert abs(plane.bodies["yaw_rad"][0]) < 0.02


@given(st.floats(-12, 6), st.floats(0, 25))
def test_pedals_are_legal_and_never_pressed_together(accel: float, speed: float) -> None:
    throttle, brake = pedals(accel, speed)
    assert 0.0 <= throttle <= 1.0
    assert 0.0 <= brake <= 1.0
    assert throttle == 0.0 or brake == 0.0


@pytest.mark.parametrize("accel", [-3.0, -1.6, 0.0, 1.2])
def test_pedals_invert_the_vehicle(accel: float) -> None:
    """Once the lags of the pedals have died out."""
    plane = Plane(9.0)
    for _ in range(40):
        speed = float(plane.bodies["speed_mps"][0])
        plane.drive(1, 0.0, *pedals(accel, speed))
    reached = (plane.bodies["speed_mps"][0] - speed) / TICK_S
    assert reached == pytest.approx(accel, abs=0.05)


def test_coasting_lies_between_throttle_and_brake() -> None:
    assert pedals(-resistance_mps2(10.0) - 0.1, 10.0) == (0.0, 0.0)
    assert pedals(-8.0, 0.0) == (0.0, 1.0)
    assert pedals(-0.1, 0.0)[1] > 0
    assert math.isclose(pedals(-4.0 - resistance_mps2(10.0), 10.0)[1], 4.0 / MAX_BRAKE_MPS2)
