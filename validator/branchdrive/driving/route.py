"""Distance of boxes to route polylines, for the route corridor.

Source: spec/05-raw-streams.md#evidence (static objects are relevant in the corridor).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.box import Boxes

__all__ = ["polyline_box_distance_m"]

Array = NDArray[np.float64]

_MAX_CELLS = 1 << 20
"""Pairs of a box and a vertex that are held at once: 8 MiB per intermediate array."""


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
    """Distance ``[n]`` from each box to one polyline ``[vertices]``, metres; 0 where they touch.

    A single vertex is a point; a route without vertices is infinitely far.
    """
    num_boxes = len(boxes.x_m)
    at_once = max(1, _MAX_CELLS // max(1, len(route_x_m)))
    parts = [
        _distance(boxes.take(np.arange(start, min(start + at_once, num_boxes))), route_x_m, route_y_m)
        for start in range(0, num_boxes, at_once)
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def _near_segments(dx: Array, dy: Array, half_diagonal_m: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pairs (box, segment) among which each box's closest segment is, boxes ascending.

    With ``p`` and ``q`` the distances of a segment's ends from the box's centre, ``s`` its length and
    ``r`` the half diagonal, the triangle inequality puts the segment at ``(p + q - s) / 2 - r`` or
    further; the closest segment is no further than the vertex nearest to the centre.
    """
    to_vertex = np.sqrt(dx * dx + dy * dy)
    length = np.hypot(np.diff(dx), np.diff(dy))
    at_least = (to_vertex[:, :-1] + to_vertex[:, 1:] - length) / 2 - half_diagonal_m
    at_most = to_vertex.min(axis=1, keepdims=True)
    far = at_least > at_most + 1e-9 * (at_most + length + half_diagonal_m)  # by more than rounding
    box, segment = np.nonzero(~far)
    return box, segment


def _distance(boxes: Boxes, route_x_m: Array, route_y_m: Array) -> Array:
    if len(route_x_m) < 2:  # a point is a segment without length
        route_x_m, route_y_m = route_x_m.repeat(2), route_y_m.repeat(2)
    if not len(route_x_m) or not len(boxes.x_m):
        return np.full(len(boxes.x_m), np.inf)
    dx, dy = route_x_m[None, :] - boxes.x_m[:, None], route_y_m[None, :] - boxes.y_m[:, None]
    box, segment = _near_segments(dx, dy, np.hypot(boxes.length_m, boxes.width_m)[:, None] / 2)
    cos, sin = np.cos(boxes.yaw_rad)[box], np.sin(boxes.yaw_rad)[box]
    half_l, half_w = boxes.length_m[box] / 2, boxes.width_m[box] / 2
    # Ends of the segments in the frames of their boxes.
    (ax, ay), (bx, by) = (
        (cos * dx[box, end] + sin * dy[box, end], cos * dy[box, end] - sin * dx[box, end])
        for end in (segment, segment + 1)
    )
    nearest = np.full(len(box), np.inf)
    for x, y in ((ax, ay), (bx, by)):
        nearest = np.minimum(nearest, np.hypot(np.maximum(np.abs(x) - half_l, 0), np.maximum(np.abs(y) - half_w, 0)))
    for sign_l, sign_w in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        nearest = np.minimum(nearest, _point_segment(sign_l * half_l, sign_w * half_w, ax, ay, bx, by))
    nearest[_segment_hits_box(ax, ay, bx, by, half_l, half_w)] = 0.0
    return np.asarray(np.minimum.reduceat(nearest, np.searchsorted(box, np.arange(len(boxes.x_m)))))
