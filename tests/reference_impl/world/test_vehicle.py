"""The ego's vehicle model against closed forms and fine integration."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.reference_impl.world.driving import GRIP, Plane

from branchdrive.contract.timing import TICK_S
from branchdrive_reference.world.vehicle import (
    BRAKE_LAG_S,
    CENTRE_TO_REAR_M,
    DRAG_1PM,
    DRIVE_LAG_S,
    ENGINE_BRAKE_1PS,
    GRAVITY_MPS2,
    MAX_BRAKE_MPS2,
    MAX_STEER_RAD,
    ROLLING_MPS2,
    WHEELBASE_M,
    drive_limit_mps2,
    resistance_mps2,
)

TICKS = 200
TIME_S = np.arange(1, TICKS + 1) * TICK_S


def resisted(speed: float) -> float:
    """Resistance, written down once more."""
    return ROLLING_MPS2 + ENGINE_BRAKE_1PS * speed + DRAG_1PM * speed**2


def test_coasting_follows_the_closed_form() -> None:
    """``du/dt = -c2 (u - r1) (u - r2)`` has ``(u - r1) / (u - r2) = q exp(-c2 (r1 - r2) t)``, roots real or not.

    A tick uses the resistance at its beginning, so the model is first order: half a tick times the change of slope.
    """
    speed = Plane(14.0).drive(TICKS)["speed_mps"]
    r1, r2 = np.roots([DRAG_1PM, ENGINE_BRAKE_1PS, ROLLING_MPS2]).astype(complex)
    q = (14.0 - r1) / (14.0 - r2) * np.exp(-DRAG_1PM * (r1 - r2) * TIME_S)
    truth = ((r1 - r2 * q) / (1.0 - q)).real
    rolling = truth > 0.0
    assert rolling.sum() > 100
    first_order = 0.5 * TICK_S * (resisted(14.0) - resisted(0.0))
    assert np.abs(speed - truth)[rolling].max() < 1.1 * first_order


@pytest.mark.parametrize("throttle", [0.3, 0.5, 0.8])
def test_constant_throttle_follows_fine_integration(throttle: float) -> None:
    def rhs(_: float, state: np.ndarray) -> list[float]:
        speed, drive = state
        wanted = throttle * drive_limit_mps2(speed)
        return [drive - resisted(speed), (wanted - drive) / DRIVE_LAG_S]

    truth = solve_ivp(rhs, (0.0, TIME_S[-1]), [5.0, 0.0], t_eval=TIME_S, rtol=1e-9, atol=1e-9).y[0]
    ego = Plane(5.0).drive(TICKS, throttle=throttle)
    assert np.abs(ego["speed_mps"] - truth).max() < 0.03
    assert (ego["y_m"] == 0.0).all()


def test_braking_distance_and_full_stop() -> None:
    """Distance and time of fine integration, the brake behind its lag."""

    def rhs(_: float, state: np.ndarray) -> list[float]:
        _, speed, pressed = state
        return [speed, -pressed - resisted(speed), (0.5 * MAX_BRAKE_MPS2 - pressed) / BRAKE_LAG_S]

    def stands(_: float, state: np.ndarray) -> float:
        return float(state[1])

    stands.terminal = True  # type: ignore[attr-defined]
    truth = solve_ivp(rhs, (0.0, 20.0), [0.0, 12.0, 0.0], events=stands, rtol=1e-9, atol=1e-9)
    ego = Plane(12.0).drive(120, brake=0.5)
    assert ego["speed_mps"].min() == 0.0
    assert ego["x_m"][-1] == pytest.approx(truth.y[0, -1], rel=5e-3)
    assert np.argmax(ego["speed_mps"] == 0.0) * TICK_S == pytest.approx(truth.t[-1], abs=2 * TICK_S)
    assert ego["x_m"][-1] == ego["x_m"][-20]


def test_braking_never_exceeds_grip() -> None:
    speed = Plane(12.0, grip=0.5).drive(40, brake=1.0)["speed_mps"]
    assert (-np.diff(speed) / TICK_S).max() <= 0.5 * GRAVITY_MPS2 + resisted(12.0) + 1e-9


@pytest.mark.parametrize("steer", [-0.3, -0.1, 0.1, 0.3])
def test_steady_turn_runs_on_the_circle_of_the_bicycle(steer: float) -> None:
    """The rear axle runs on ``R = L / tan(d)``, the centre on ``sqrt(R^2 + l_r^2)``."""
    plane = Plane(4.0)
    plane.drive(60, steer=steer)  # the steering lag dies out
    ego = plane.drive(30, steer=steer)
    rear_radius = WHEELBASE_M / math.tan(MAX_STEER_RAD * abs(steer))
    yaw = ego["yaw_rad"]
    left_x, left_y = -np.sin(yaw), np.cos(yaw)
    side = -math.copysign(1.0, steer)
    centre_x = ego["x_m"] - CENTRE_TO_REAR_M * np.cos(yaw) + side * rear_radius * left_x
    centre_y = ego["y_m"] - CENTRE_TO_REAR_M * np.sin(yaw) + side * rear_radius * left_y
    assert np.ptp(centre_x) < 0.01 * rear_radius
    assert np.ptp(centre_y) < 0.01 * rear_radius
    distance = np.hypot(ego["x_m"] - centre_x, ego["y_m"] - centre_y)
    assert distance == pytest.approx(np.full(30, math.hypot(rear_radius, CENTRE_TO_REAR_M)), rel=1e-9)
    assert ego["yaw_rate_radps"] == pytest.approx(side * ego["speed_mps"] / rear_radius, rel=1e-3)


def test_resistance_is_that_of_rolling_engine_and_air() -> None:
    assert [resistance_mps2(speed) for speed in (0.0, 10.0, -10.0)] == [resisted(speed) for speed in (0.0, 10.0, 10.0)]


def test_positive_steering_turns_right() -> None:
    right, left = Plane(8.0).drive(40, steer=0.2)[-1], Plane(8.0).drive(40, steer=-0.2)[-1]
    assert right["y_m"] < -1.0
    assert right["yaw_rad"] < -0.1
    assert (left["y_m"], left["yaw_rad"]) == (-right["y_m"], -right["yaw_rad"])


def test_lateral_acceleration_is_limited_by_grip() -> None:
    plane = Plane(15.0)
    rows = plane.drive(100, steer=1.0)
    assert (np.abs(rows["yaw_rate_radps"]) * rows["speed_mps"]).max() <= GRIP * GRAVITY_MPS2 * (1 + 1e-9)


def test_recorded_acceleration_is_that_of_the_last_tick() -> None:
    plane = Plane(6.0)
    before = plane.drive(10, throttle=0.6)[-1]["speed_mps"]
    after = plane.drive(1, throttle=0.6)[-1]["speed_mps"]
    assert plane.vehicle["accel_longitudinal_mps2"][0] == pytest.approx((after - before) / TICK_S)
