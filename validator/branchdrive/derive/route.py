"""Distance of boxes to route polylines, for the route corridor.

Source: spec/05-raw-streams.md#evidence (static objects are relevant in the corridor).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.derive.box import Boxes

__all__ = ["polyline_box_distance_m"]

Array = NDArray[np.float64]


def _point_segment(px: Array, py: Array, ax: Array, ay: Array, bx: Array, by: Array) -> Array:
    ex, ey = bx - ax, by - ay
    square = ex * ex + ey * ey
    along = np.divide((px - ax) * ex + (py - ay) * ey, square, out=np.zeros_like(square), where=square > 0)
    along = np.clip(along, 0.0, 1.0)
    return np.asarray(np.hypot(px - ax - along * ex, py - ay - along * ey))


def _segment_hits_box(ax: Array, ay: Array, bx: Array, by: Array, half_l: Array, half_w: Array) -> NDArray[np.bool_]:
    """Whether segments cross axis-aligned boxes at the origin (separating axes: x, y, segment normal)."""
    beside = (np.minimum(ax, bx) > half_l) | (np.maximum(ax, bx) < -half_l)
    beside |= (np.minimum(ay, by) > half_w) | (np.maximum(ay, by) < -half_w)
    ex, ey = bx - ax, by - ay
    beside |= np.abs(ax * ey - ay * ex) > half_l * np.abs(ey) + half_w * np.abs(ex)
    return np.asarray(~beside)


def polyline_box_distance_m(boxes: Boxes, route_x_m: Array, route_y_m: Array) -> Array:
    """Distance ``[n]`` from each box to one polyline ``[vertices]``, metres; 0 where they touch."""
    cos, sin = np.cos(boxes.yaw_rad)[:, None], np.sin(boxes.yaw_rad)[:, None]
    dx, dy = route_x_m[None, :] - boxes.x_m[:, None], route_y_m[None, :] - boxes.y_m[:, None]
    x, y = cos * dx + sin * dy, cos * dy - sin * dx  # vertices in each box's frame, [n, vertices]
    half_l, half_w = boxes.length_m[:, None] / 2, boxes.width_m[:, None] / 2
    to_vertex = np.hypot(np.maximum(np.abs(x) - half_l, 0), np.maximum(np.abs(y) - half_w, 0)).min(axis=1)
    ax, ay, bx, by = x[:, :-1], y[:, :-1], x[:, 1:], y[:, 1:]
    nearest = to_vertex
    for sign_l, sign_w in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        corner = _point_segment(sign_l * half_l, sign_w * half_w, ax, ay, bx, by)
        nearest = np.minimum(nearest, corner.min(axis=1))
    hit = _segment_hits_box(ax, ay, bx, by, half_l, half_w).any(axis=1)
    return np.where(hit, 0.0, nearest)
