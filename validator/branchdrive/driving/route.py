"""Route polylines: where a point lies along them, and how far boxes are from them.

The foot of a point ``p`` on the segment from ``a`` to ``b`` at arc length ``s_a``, with ``e = b - a``::

    t        = clip((p - a) . e / |e|^2, 0, 1)
    progress = s_a + t |e|
    offset   = |p - a - t e|, negative where e x (p - a) < 0, that is to the right
    heading  = atan2(e_y, e_x)

The position of a point is its nearest foot, and the one of smallest progress among the nearest. A point
before the first vertex or beyond the last has its foot there.

Source: spec/05-raw-streams.md#projection, and #evidence (static objects are relevant in the corridor).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.box import Boxes

__all__ = ["Feet", "Polylines", "RoutePosition", "feet_within", "points_near", "polyline_box_distance_m", "project"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_MAX_CELLS = 1 << 18
"""Pairs of a box or a point and a vertex that are held at once: 2 MiB per intermediate array."""

_BLOCK_SEGMENTS = 10
"""Neighbouring segments that one circle encloses."""

_MAX_PIECES = 1e9
"""Pieces of a segment: positions end at 1e7 m."""

_ABOVE = 1 + 1e-9
"""Factor by more than rounding."""


class RoutePosition(NamedTuple):
    """Points relative to a polyline, each field ``[points]``.

    Attributes:
        progress_m: Arc length of the foot.
        offset_m: Distance from the foot, positive to the left.
        heading_rad: Direction of the segment that holds the foot.
    """

    progress_m: Array
    offset_m: Array
    heading_rad: Array


class Feet(NamedTuple):
    """Feet of points on segments, each field ``[feet]``, in no order.

    Attributes:
        point: Which point.
        position: The foot.
    """

    point: NDArray[np.intp]
    position: RoutePosition


def project(x_m: Array, y_m: Array, route_x_m: Array, route_y_m: Array) -> RoutePosition:
    """Positions of points ``[points]`` on a polyline ``[vertices]``, at least two, no two neighbours equal."""
    point, position = feet_within(x_m, y_m, route_x_m, route_y_m, np.full(len(x_m), np.inf))
    order = np.lexsort((position.progress_m, np.abs(position.offset_m), point))
    first = order[np.diff(point[order], prepend=-1) > 0]
    return RoutePosition(*(values[first] for values in position))


def feet_within(x_m: Array, y_m: Array, route_x_m: Array, route_y_m: Array, reach_m: Array) -> Feet:
    """`Polylines.feet_within` of one polyline."""
    return Polylines([(route_x_m, route_y_m)]).feet_within(x_m, y_m, np.zeros(len(x_m), np.int64), reach_m)


class Polylines:
    """Polylines whose neighbouring segments are enclosed by circles, so that feet of many points are found at once.

    Args:
        polylines: Vertices x and y of each, at least two, no two neighbours equal.

    Attributes:
        length_m: How long each is ``[polylines]``.
    """

    def __init__(self, polylines: Sequence[tuple[Array, Array]]) -> None:
        num_segments = np.array([len(x) - 1 for x, _ in polylines], np.int64)
        x, y = (np.concatenate([vertices[axis] for vertices in polylines]) for axis in (0, 1))
        polyline = np.repeat(np.arange(len(polylines)), num_segments)
        first_segment = np.cumsum(num_segments) - num_segments
        first = np.arange(len(polyline)) + polyline  # vertex at which each segment begins
        self._x, self._y = x[first], y[first]
        self._ex, self._ey = np.diff(x)[first], np.diff(y)[first]
        self._square = self._ex * self._ex + self._ey * self._ey
        self._length, self._heading = np.hypot(self._ex, self._ey), np.arctan2(self._ey, self._ex)
        self._arc = np.concatenate(
            [np.append(0.0, np.cumsum(part)[:-1]) for part in _split(self._length, num_segments)]
        )
        self.length_m = np.add.reduceat(self._length, first_segment)

        self._num_blocks = -(-num_segments // _BLOCK_SEGMENTS)
        self._first_block = np.cumsum(self._num_blocks) - self._num_blocks
        owner, place = _ranges(self._num_blocks)
        self._segment = first_segment[owner] + place * _BLOCK_SEGMENTS
        self._num_segments = np.minimum(num_segments[owner] - place * _BLOCK_SEGMENTS, _BLOCK_SEGMENTS)
        vertex = self._segment + owner + np.minimum(np.arange(_BLOCK_SEGMENTS + 1)[:, None], self._num_segments)
        xs, ys = x[vertex], y[vertex]  # [vertices, blocks]
        self._centre_x, self._centre_y = ((v.min(axis=0) + v.max(axis=0)) / 2 for v in (xs, ys))
        self._radius = np.hypot(xs - self._centre_x, ys - self._centre_y).max(axis=0) * _ABOVE

    def feet_within(self, x_m: Array, y_m: Array, polyline: Index, reach_m: Array) -> Feet:
        """Feet of points on their polylines that are no further from them than `reach_m`.

        Where a point's reach is beyond a circle around some part of its polyline, feet outside of that circle may be
        left out: they are not the nearest.

        Args:
            x_m: The points ``[points]``.
            y_m: The same, y.
            polyline: Polyline of each ``[points]``.
            reach_m: How far feet matter ``[points]``.
        """
        cells = np.cumsum(self._num_blocks[polyline]) * _BLOCK_SEGMENTS
        bounds = np.searchsorted(cells, np.arange(0, cells[-1] if len(cells) else 1, _MAX_CELLS))
        parts = [
            self._feet(np.arange(start, stop), x_m, y_m, polyline, reach_m)
            for start, stop in zip(bounds, np.append(bounds[1:], len(x_m)), strict=True)
            if start < stop or not len(x_m)
        ]
        position = RoutePosition(*map(np.concatenate, zip(*(part.position for part in parts), strict=True)))
        return Feet(np.concatenate([part.point for part in parts]), position)

    def _feet(self, points: Index, x_m: Array, y_m: Array, polyline: Index, reach_m: Array) -> Feet:
        counts = self._num_blocks[polyline[points]]
        owner, place = _ranges(counts)
        point, block = points[owner], self._first_block[polyline[points]][owner] + place
        dx, dy = x_m[point] - self._centre_x[block], y_m[point] - self._centre_y[block]
        distance, radius = np.sqrt(dx * dx + dy * dy), self._radius[block]
        if not len(point):
            return Feet(point, RoutePosition(distance, distance, distance))
        nearest = np.minimum.reduceat(distance + radius, np.cumsum(counts) - counts)
        reach = np.minimum(reach_m[points], nearest) * _ABOVE
        near = np.flatnonzero(distance <= reach[owner] + radius)
        owner, place = _ranges(self._num_segments[block[near]])
        return self._feet_on(point[near][owner], self._segment[block[near]][owner] + place, x_m, y_m, reach_m)

    def _feet_on(self, point: Index, segment: Index, x_m: Array, y_m: Array, reach_m: Array) -> Feet:
        """Feet of points on segments, those that are near enough."""
        px, py = x_m[point] - self._x[segment], y_m[point] - self._y[segment]
        sx, sy = self._ex[segment], self._ey[segment]
        along = np.clip((px * sx + py * sy) / self._square[segment], 0.0, 1.0)
        off_x, off_y = px - along * sx, py - along * sy
        distance = np.sqrt(off_x * off_x + off_y * off_y)
        kept = np.flatnonzero(distance <= reach_m[point])
        point, segment, distance = point[kept], segment[kept], distance[kept]
        is_right = sx[kept] * py[kept] - sy[kept] * px[kept] < 0
        progress = self._arc[segment] + along[kept] * self._length[segment]
        offset = np.where(is_right, -distance, distance)
        return Feet(point, RoutePosition(progress, offset, self._heading[segment]))


def _ranges(counts: Index) -> tuple[Index, Index]:
    """Owner and place within it of ``counts[i]`` items of every owner ``i``."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)


def _split(values: Array, counts: Index) -> list[Array]:
    return np.split(values, np.cumsum(counts)[:-1])


def points_near(
    x_m: float, y_m: float, route_x_m: Array, route_y_m: Array, reach_m: float, *, most: int
) -> tuple[Array, Array]:
    """Points of a polyline near a place: its vertices, and what parts segments into equal pieces of at most 1 m.

    Args:
        x_m: The place.
        y_m: The same, y.
        route_x_m: Vertices, at least two, no two neighbours equal.
        route_y_m: The same, y.
        reach_m: No point this near to the place is left out; others may be among them.
        most: How many points are wanted; where there are more, one more is given.

    Returns:
        World frame, in driving order, each ``[points]``.
    """
    ex, ey = np.diff(route_x_m), np.diff(route_y_m)
    square = ex * ex + ey * ey
    length = np.sqrt(square)
    pieces = np.clip(np.ceil(length), 1, _MAX_PIECES)
    foot = ((x_m - route_x_m[:-1]) * ex + (y_m - route_y_m[:-1]) * ey) / square
    first, last = ((foot + side * reach_m / length) * pieces for side in (-1, 1))
    first, last = np.clip(np.floor(first), 0, pieces), np.clip(np.ceil(last), -1, pieces - 1)
    last[-1] += last[-1] == pieces[-1] - 1  # the last vertex begins no segment
    off = np.hypot(route_x_m[:-1] + foot * ex - x_m, route_y_m[:-1] + foot * ey - y_m)
    counts = np.where(off <= reach_m * _ABOVE, np.maximum(last - first + 1, 0), 0)
    counts = np.diff(np.minimum(np.cumsum(counts), most + 1), prepend=0).astype(np.int64)
    segment = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(len(segment)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (first[segment] + place) / pieces[segment]
    return route_x_m[segment] + share * ex[segment], route_y_m[segment] + share * ey[segment]


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
