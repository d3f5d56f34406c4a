"""Intelligent driver model.

``a = a_0 [1 - (v / v_0)^4 - (s* / s)^2]`` with ``s* = s_0 + max(0, v T + v (v - v_lead) / (2 sqrt(a_0 b)))``.
Source: Treiber, Hennecke and Helbing, "Congested traffic states in empirical observations and
microscopic simulations", Physical Review E 62 (2000).
"""

from __future__ import annotations

import math

from branchdrive_reference.kernel import kernel

__all__ = ["HARDEST_BRAKE_MPS2", "desired_gap_m", "idm_accel_mps2"]

HARDEST_BRAKE_MPS2 = 8.0
_SMALLEST_GAP_M = 0.1


@kernel
def desired_gap_m(
    speed_mps: float, lead_speed_mps: float, headway_s: float, standstill_m: float, accel_mps2: float, brake_mps2: float
) -> float:
    """Gap ``s*`` that the driver wants to keep."""
    dynamic = speed_mps * headway_s
    dynamic += speed_mps * (speed_mps - lead_speed_mps) / (2.0 * math.sqrt(accel_mps2 * brake_mps2))
    return standstill_m + max(0.0, dynamic)


@kernel
def idm_accel_mps2(
    speed_mps: float, desired_speed_mps: float, gap_m: float, wanted_gap_m: float, accel_mps2: float
) -> float:
    """Acceleration, not below the hardest braking; `gap_m` is bumper to bumper, infinity without a leader."""
    free = (speed_mps / desired_speed_mps) ** 4
    blocked = (wanted_gap_m / max(gap_m, _SMALLEST_GAP_M)) ** 2
    return max(accel_mps2 * (1.0 - free - blocked), -HARDEST_BRAKE_MPS2)
