"""Lateral control: pure pursuit of the reference path from the rear axle.

With the sighted point ``(x, y)`` in the frame of the rear axle, the arc through it has curvature
``k = 2 y / (x^2 + y^2)`` and the steering angle is ``atan(L k)``. Source: Coulter, "Implementation
of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01 (1992).
"""

from __future__ import annotations

import math

from branchdrive_reference.expert.plan import reference_offset_m
from branchdrive_reference.geometry.path import interpolate
from branchdrive_reference.kernel import Records, kernel
from branchdrive_reference.world.vehicle import CENTRE_TO_REAR_M, MAX_STEER_RAD, WHEELBASE_M

__all__ = ["pursuit_curvature_1pm", "sight_m", "steer_command"]

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
