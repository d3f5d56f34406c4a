"""Oriented boxes in the plane, as compiled predicates.

Angles in radians, counter-clockwise.
"""

from __future__ import annotations

import math

from branchdrive_reference.kernel import kernel

__all__ = ["boxes_overlap", "half_extent_along", "wrap"]


@kernel
def half_extent_along(angle_rad: float, length_m: float, width_m: float) -> float:
    """Half the shadow of a box on an axis at `angle_rad` from its own x axis.

    ``(length |cos angle| + width |sin angle|) / 2``
    """
    return 0.5 * (length_m * abs(math.cos(angle_rad)) + width_m * abs(math.sin(angle_rad)))


@kernel
def boxes_overlap(
    x_a_m: float, y_a_m: float, yaw_a_rad: float, length_a_m: float, width_a_m: float,
    x_b_m: float, y_b_m: float, yaw_b_rad: float, length_b_m: float, width_b_m: float,
) -> bool:  # fmt: skip
    """Whether two boxes (centre, heading, full extents) share a point: separating-axis theorem."""
    dx, dy = x_b_m - x_a_m, y_b_m - y_a_m
    reach = 0.5 * (length_a_m + width_a_m + length_b_m + width_b_m)
    if dx * dx + dy * dy > reach * reach:
        return False
    turn = yaw_b_rad - yaw_a_rad
    cos_a, sin_a = math.cos(yaw_a_rad), math.sin(yaw_a_rad)
    along, across = abs(cos_a * dx + sin_a * dy), abs(cos_a * dy - sin_a * dx)
    if along > 0.5 * length_a_m + half_extent_along(turn, length_b_m, width_b_m):
        return False
    if across > 0.5 * width_a_m + half_extent_along(turn, width_b_m, length_b_m):
        return False
    cos_b, sin_b = math.cos(yaw_b_rad), math.sin(yaw_b_rad)
    along, across = abs(cos_b * dx + sin_b * dy), abs(cos_b * dy - sin_b * dx)
    if along > 0.5 * length_b_m + half_extent_along(turn, length_a_m, width_a_m):
        return False
    return across <= 0.5 * width_b_m + half_extent_along(turn, width_a_m, length_a_m)


@kernel
def wrap(angle_rad: float) -> float:
    """The same direction in ``[-pi, pi]``."""
    return math.atan2(math.sin(angle_rad), math.cos(angle_rad))
