"""What the expert remembers and decides, and where its reference path runs.

The reference path is the route, shifted to the left by

    d(s) = D * ramp((s - begin) / (full - begin)) * (1 - ramp((s - hold) / (end - hold)))

with ``ramp(r) = (1 - cos(pi clip(r, 0, 1))) / 2``: a smooth lane shift around an obstacle. ``D = 0``
leaves the route as it is.
"""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np

from branchdrive_reference.kernel import Records, kernel

__all__ = ["PLAN", "Cause", "reference_offset_m"]


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
