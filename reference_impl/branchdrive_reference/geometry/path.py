"""Paths as vertex tables for kernels: interpolation by arc length and projection with a hint.

A path is a slice of a `VERTEX` array. Kernels take ``path[first:end]`` and indices inside it.
"""

from __future__ import annotations

import math

import numpy as np

from branchdrive_reference.kernel import Records, kernel

__all__ = ["VERTEX", "interpolate", "locate", "project"]

VERTEX = np.dtype(
    [
        ("x_m", np.float64),
        ("y_m", np.float64),
        ("arc_m", np.float64),
        ("tangent_rad", np.float64),  # unwrapped along the path
        ("advisory_speed_mps", np.float64),  # speed limit and curvature, with room to brake
        ("left_lane", np.int64),  # `LaneSide` beyond the left edge of the path's lane
        ("right_lane", np.int64),
    ],
    align=True,
)
"""One vertex of a path."""


@kernel
def locate(path: Records, arc_m: float) -> int:
    """Index of the segment that holds an arc length; the end segments reach to infinity."""
    last = int(path.shape[0]) - 2
    begin, end = path[0].arc_m, path[last + 1].arc_m
    index = int((arc_m - begin) / (end - begin) * (last + 1))
    index = min(max(index, 0), last)
    while index < last and arc_m >= path[index + 1].arc_m:
        index += 1
    while index > 0 and arc_m < path[index].arc_m:
        index -= 1
    return index


@kernel
def interpolate(path: Records, arc_m: float, left_m: float) -> tuple[float, float, float]:
    """Pose ``(x, y, tangent)`` at an arc length, `left_m` to the left of the path."""
    index = locate(path, arc_m)
    a, b = path[index], path[index + 1]
    share = (arc_m - a.arc_m) / (b.arc_m - a.arc_m)
    tangent = a.tangent_rad + share * (b.tangent_rad - a.tangent_rad)
    x = a.x_m + share * (b.x_m - a.x_m) - left_m * math.sin(tangent)
    y = a.y_m + share * (b.y_m - a.y_m) + left_m * math.cos(tangent)
    return x, y, tangent


@kernel
def _foot(path: Records, index: int, x_m: float, y_m: float) -> tuple[float, float, float]:
    """Squared distance, share along the segment and signed area of a point and one segment."""
    a, b = path[index], path[index + 1]
    ex, ey = b.x_m - a.x_m, b.y_m - a.y_m
    px, py = x_m - a.x_m, y_m - a.y_m
    share = min(max((px * ex + py * ey) / (ex * ex + ey * ey), 0.0), 1.0)
    dx, dy = px - share * ex, py - share * ey
    return dx * dx + dy * dy, share, ex * py - ey * px


@kernel
def project(path: Records, x_m: float, y_m: float, hint: int) -> tuple[float, float, int]:
    """Arc length, offset (left positive) and segment of the foot point nearest to the hinted segment.

    Walks downhill in distance from segment `hint`, which finds the global foot point as long as the
    hint is on the same bend; callers pass the segment of the previous tick.
    """
    last = path.shape[0] - 2
    index = min(max(hint, 0), last)
    best, share, side = _foot(path, index, x_m, y_m)
    step = 1
    turned = False
    while True:
        nxt = index + step
        moved = False
        if 0 <= nxt <= last:
            distance, nxt_share, nxt_side = _foot(path, nxt, x_m, y_m)
            if distance < best:
                index, best, share, side = nxt, distance, nxt_share, nxt_side
                moved = True
        if not moved:
            if turned:
                break
            turned = True
            step = -1
    a, b = path[index], path[index + 1]
    arc = a.arc_m + share * (b.arc_m - a.arc_m)
    offset = math.sqrt(best)
    return arc, -offset if side < 0.0 else offset, index
