"""Lateral control: pure pursuit of the reference path from the rear axle.

With the sighted point ``(x, y)`` in the frame of the rear axle, the arc through it has curvature
``k = 2 y / (x^2 + y^2)`` and the steering angle is ``atan(L k)``. Source: Coulter, "Implementation
of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01 (1992).

Pedals for a wanted acceleration: the vehicle's longitudinal model, inverted.

What the expert remembers and decides, and where its reference path runs.

The reference path is the route, shifted to the left by

    d(s) = D * ramp((s - begin) / (full - begin)) * (1 - ramp((s - hold) / (end - hold)))

with ``ramp(r) = (1 - cos(pi clip(r, 0, 1))) / 2``: a smooth lane shift around an obstacle. ``D = 0``
leaves the route as it is.
"""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np

from branchdrive_reference.geometry.polyline import interpolate
from branchdrive_reference.kernel import Records, kernel
from branchdrive_reference.world.vehicle import (
    CENTRE_TO_REAR_M,
    MAX_BRAKE_MPS2,
    MAX_STEER_RAD,
    WHEELBASE_M,
    drive_limit_mps2,
    resistance_mps2,
)

__all__ = ["PLAN", "Cause", "pedals", "pursuit_curvature_1pm", "reference_offset_m", "sight_m", "steer_command"]

_SIGHT_S, _SIGHT_OFFSET_M, _SIGHT_MIN_M, _SIGHT_MAX_M = 0.6, 2.5, 4.0, 13.0
_MAX_LATERAL_ACCEL_MPS2 = 5.0


@kernel
def sight_m(speed_mps: float) -> float:
    """How far ahead of the box centre the sighted point lies along the path."""
    return min(max(_SIGHT_OFFSET_M + _SIGHT_S * speed_mps, _SIGHT_MIN_M), _SIGHT_MAX_M)


@kernel
def pursuit_curvature_1pm(
    plan: Records, path: Records, x_m: float, y_m: float, yaw_rad: float, arc_m: float, speed_mps: float
) -> float:
    """Curvature, positive to the left, from a box centre at ``(x, y, yaw)`` with foot point `arc_m`."""
    sighted_m = arc_m + sight_m(speed_mps)
    px, py, _ = interpolate(path, sighted_m, reference_offset_m(plan, sighted_m))
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    dx, dy = px - (x_m - CENTRE_TO_REAR_M * cos), py - (y_m - CENTRE_TO_REAR_M * sin)
    curvature = 2.0 * (cos * dy - sin * dx) / (dx * dx + dy * dy)
    limit = min(math.tan(MAX_STEER_RAD) / WHEELBASE_M, _MAX_LATERAL_ACCEL_MPS2 / max(speed_mps * speed_mps, 1.0))
    return float(min(max(curvature, -limit), limit))


@kernel
def steer_command(curvature_1pm: float) -> float:
    """Steering command, positive to the right, for a curvature positive to the left."""
    return -math.atan(WHEELBASE_M * curvature_1pm) / MAX_STEER_RAD


_COASTING_BAND_MPS2 = 0.25
_HOLD_SPEED_MPS, _HOLD_BRAKE = 0.3, 0.4


@kernel
def pedals(accel_mps2: float, speed_mps: float) -> tuple[float, float]:
    """Throttle and brake, each in ``[0, 1]`` and never both.

    Just below the coasting deceleration neither pedal is pressed; near standstill the brake holds.
    """
    if accel_mps2 < 0.0 and speed_mps < _HOLD_SPEED_MPS:
        return 0.0, max(_HOLD_BRAKE, min(-accel_mps2 / MAX_BRAKE_MPS2, 1.0))
    surplus = accel_mps2 + resistance_mps2(speed_mps)
    if surplus >= 0.0:
        return min(surplus / drive_limit_mps2(speed_mps), 1.0), 0.0
    if surplus > -_COASTING_BAND_MPS2:
        return 0.0, 0.0
    return 0.0, min(-surplus / MAX_BRAKE_MPS2, 1.0)


class Cause(IntEnum):
    """What sets the expert's acceleration."""

    CRUISE = 0
    LEADER = 1
    PEDESTRIAN = 2
    CONFLICT = 3
    SIGNAL = 4
    PRIORITY = 5


PLAN = np.dtype(
    [
        ("shift_m", np.float64),  # D, to the left; 0 without a shift
        ("begin_m", np.float64),  # arc lengths on the route
        ("full_m", np.float64),
        ("hold_m", np.float64),
        ("end_m", np.float64),
        ("obstacle", np.int64),  # row of the body that is passed, or that the ego makes way for
        ("stopped", np.int64),  # whether the ego has stopped at the stop sign of its route
        ("target_speed_mps", np.float64),
        ("sighted_offset_m", np.float64),  # reference offset at the point the steering looks at
        ("cause", np.int64),  # `Cause`
        ("steer", np.float32),  # positive to the right
        ("throttle", np.float32),
        ("brake", np.float32),
    ],
    align=True,
)
"""State of the expert and its decision of this tick."""


@kernel
def _ramp(share: float) -> float:
    return 0.5 - 0.5 * math.cos(math.pi * min(max(share, 0.0), 1.0))


@kernel
def reference_offset_m(plan: Records, arc_m: float) -> float:
    """Offset of the reference path from the route at an arc length; `plan` is a `PLAN` row."""
    if plan.shift_m == 0.0:
        return 0.0
    rise = _ramp((arc_m - plan.begin_m) / max(plan.full_m - plan.begin_m, 0.1))
    fall = _ramp((arc_m - plan.hold_m) / max(plan.end_m - plan.hold_m, 0.1))
    return float(plan.shift_m * rise * (1.0 - fall))
