"""The ego: kinematic bicycle with first-order actuators, drag and a tyre limit.

State in the body frame: longitudinal speed ``u`` (of the whole axis), lateral velocity ``v`` and yaw
rate ``w`` of the box centre, which lies ``l_r`` before the rear axle. With steering angle ``d``
(counter-clockwise) and wheelbase ``L``

    w* = u tan(d) / L,    |w* u| <= grip g        v* = l_r w*

and the tyres pull ``v`` and ``w`` towards ``v*`` and ``w*`` no faster than grip allows; in normal
driving they are equal, after a collision the slip dies out. Longitudinally

    du/dt = drive - sign(u) (brake + c_0 + c_1 |u| + c_2 u^2),    drive <= min(a_max, P / u)

with ``drive`` and ``brake`` following throttle and brake pedals as first-order lags, averaged over the tick.
Resistance stops the vehicle and never reverses it. Steering commands are positive to the right, so ``d`` is
``-max_angle * steer``.
"""

from __future__ import annotations

import math

import numpy as np

from branchdrive.contract.timing import TICK_S
from branchdrive_reference.kernel import Records, kernel
from branchdrive_reference.world.body import Size

__all__ = [
    "CENTRE_TO_REAR_M",
    "EGO_SIZE",
    "GRAVITY_MPS2",
    "MAX_BRAKE_MPS2",
    "MAX_DRIVE_MPS2",
    "MAX_STEER_RAD",
    "VEHICLE",
    "WHEELBASE_M",
    "accelerate",
    "drive_limit_mps2",
    "resistance_mps2",
    "slip",
    "turn",
]

EGO_SIZE = Size(length_m=4.7, width_m=1.9, height_m=1.5, mass_kg=1600.0)
WHEELBASE_M = 2.8
CENTRE_TO_REAR_M = 1.4
GRAVITY_MPS2 = 9.81
MAX_STEER_RAD = 0.6
MAX_DRIVE_MPS2 = 4.0
MAX_POWER_WPKG = 90.0
MAX_BRAKE_MPS2 = 8.0
ROLLING_MPS2 = 0.30
ENGINE_BRAKE_1PS = 0.05
DRAG_1PM = 0.0005
MAX_YAW_ACCEL_RADPS2 = 20.0
STEER_LAG_S = 0.12
DRIVE_LAG_S = 0.25
BRAKE_LAG_S = 0.10

_STEER_SHARE = 1.0 - math.exp(-TICK_S / STEER_LAG_S)
_DRIVE_SHARE = 1.0 - math.exp(-TICK_S / DRIVE_LAG_S)
_BRAKE_SHARE = 1.0 - math.exp(-TICK_S / BRAKE_LAG_S)

VEHICLE = np.dtype(
    [
        ("forward_mps", np.float64),
        ("lateral_mps", np.float64),  # to the left
        ("yaw_rate_radps", np.float64),
        ("steer_rad", np.float64),  # counter-clockwise
        ("drive_mps2", np.float64),
        ("brake_mps2", np.float64),
        ("accel_longitudinal_mps2", np.float64),  # over the last tick
        ("accel_lateral_mps2", np.float64),
    ],
    align=True,
)
"""State of the ego beyond its pose."""


@kernel
def resistance_mps2(forward_mps: float) -> float:
    """Deceleration by rolling, engine and air: ``c_0 + c_1 |u| + c_2 u^2``."""
    return ROLLING_MPS2 + ENGINE_BRAKE_1PS * abs(forward_mps) + DRAG_1PM * forward_mps * forward_mps


@kernel
def drive_limit_mps2(forward_mps: float) -> float:
    """Acceleration at full throttle: ``min(a_max, P / u)``."""
    return min(MAX_DRIVE_MPS2, MAX_POWER_WPKG / max(abs(forward_mps), 1.0))


@kernel
def accelerate(vehicle: Records, throttle: float, brake: float, grip: float) -> float:
    """Forward speed after one tick; moves the pedal lags of `vehicle` (a `VEHICLE` row)."""
    speed = vehicle.forward_mps
    drive, pressed = vehicle.drive_mps2, vehicle.brake_mps2
    vehicle.drive_mps2 += _DRIVE_SHARE * (throttle * drive_limit_mps2(speed) - drive)
    vehicle.brake_mps2 += _BRAKE_SHARE * (brake * MAX_BRAKE_MPS2 - pressed)
    limit = grip * GRAVITY_MPS2
    pushed = speed + min(0.5 * (drive + vehicle.drive_mps2), limit) * TICK_S
    slowed = (min(0.5 * (pressed + vehicle.brake_mps2), limit) + resistance_mps2(speed)) * TICK_S
    return math.copysign(max(abs(pushed) - slowed, 0.0), pushed)


@kernel
def turn(vehicle: Records, forward_mps: float, steer: float, grip: float) -> tuple[float, float]:
    """Lateral velocity and yaw rate after one tick; moves the steering lag of `vehicle`."""
    vehicle.steer_rad += _STEER_SHARE * (-MAX_STEER_RAD * steer - vehicle.steer_rad)
    limit = grip * GRAVITY_MPS2
    max_rate = limit / max(abs(forward_mps), 0.1)
    rate = min(max(forward_mps * math.tan(vehicle.steer_rad) / WHEELBASE_M, -max_rate), max_rate)
    lateral_mps = slip(vehicle.lateral_mps, CENTRE_TO_REAR_M * rate, limit * TICK_S)
    return lateral_mps, slip(vehicle.yaw_rate_radps, rate, MAX_YAW_ACCEL_RADPS2 * TICK_S)


@kernel
def slip(value: float, target: float, max_change: float) -> float:
    """`value` moved towards `target` by at most `max_change`."""
    return value + min(max(target - value, -max_change), max_change)
