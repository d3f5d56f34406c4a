"""Polylines with arc length: construction by numpy, exact foot points, resampling and offsets.

Paths as vertex tables for kernels: interpolation by arc length and projection with a hint.

A path is a slice of a `VERTEX` array. Kernels take ``path[first:end]`` and indices inside it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.route import RoutePosition
from branchdrive.driving.route import project as route_position
from branchdrive_reference.kernel import Records, kernel

__all__ = ["VERTEX", "Array", "Polyline", "bezier", "interpolate", "join", "locate", "project"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Polyline:
    """Vertices ``x_m, y_m`` ``[vertices]``, at least two, no two neighbours equal."""

    x_m: Array
    y_m: Array

    def __repr__(self) -> str:
        return f"Polyline({len(self.x_m)} vertices, {self.length_m:.1f} m)"

    @cached_property
    def arc_m(self) -> Array:
        """Arc length at every vertex, from 0 ``[vertices]``."""
        steps = np.hypot(np.diff(self.x_m), np.diff(self.y_m))
        return np.concatenate([np.zeros(1), np.cumsum(steps)])

    @property
    def length_m(self) -> float:
        """Total arc length."""
        return float(self.arc_m[-1])

    @cached_property
    def tangent_rad(self) -> Array:
        """Unwrapped tangent at every vertex: the mean direction of the segments that meet there ``[vertices]``."""
        segment = np.unwrap(np.arctan2(np.diff(self.y_m), np.diff(self.x_m)))
        return np.concatenate([segment[:1], 0.5 * (segment[1:] + segment[:-1]), segment[-1:]])

    def at(self, arc_m: Array) -> tuple[Array, Array]:
        """Points at arc lengths, clamped to the ends ``[n]``."""
        arc = self.arc_m
        return np.interp(arc_m, arc, self.x_m), np.interp(arc_m, arc, self.y_m)

    def resampled(self, step_m: float) -> Polyline:
        """The polyline with vertices at equal arc lengths, about `step_m` apart; both ends stay."""
        count = max(1, round(self.length_m / step_m))
        return Polyline(*self.at(np.linspace(0.0, self.length_m, count + 1)))

    def cut(self, begin_m: float, end_m: float) -> Polyline:
        """The part between two arc lengths, ends included."""
        arc = self.arc_m
        inside = (arc > begin_m + 1e-9) & (arc < end_m - 1e-9)
        (x0, x1), (y0, y1) = self.at(np.array([begin_m, end_m]))
        return Polyline(np.concatenate([[x0], self.x_m[inside], [x1]]), np.concatenate([[y0], self.y_m[inside], [y1]]))

    def shifted(self, left_m: float | Array) -> Polyline:
        """The curve `left_m` to the left of every vertex, parallel where that is one number for all of them."""
        tangent = self.tangent_rad
        return Polyline(self.x_m - left_m * np.sin(tangent), self.y_m + left_m * np.cos(tangent))

    def simplified(self, tolerance_m: float) -> Polyline:
        """The polyline of those vertices that keep every other one within a distance of it; both ends stay.

        Douglas and Peucker: a stretch is cut at its farthest vertex until none is too far from its chord.
        """
        keep = np.zeros(len(self.x_m), np.bool_)
        keep[[0, -1]] = True
        open_stretches = [(0, len(self.x_m) - 1)]
        while open_stretches:
            first, last = open_stretches.pop()
            if last - first < 2:
                continue
            x, y = self.x_m[first + 1 : last] - self.x_m[first], self.y_m[first + 1 : last] - self.y_m[first]
            chord_x, chord_y = self.x_m[last] - self.x_m[first], self.y_m[last] - self.y_m[first]
            along = np.clip((x * chord_x + y * chord_y) / max(chord_x**2 + chord_y**2, 1e-12), 0.0, 1.0)
            away = np.hypot(x - along * chord_x, y - along * chord_y)
            if away.max() > tolerance_m:
                farthest = first + 1 + int(away.argmax())
                keep[farthest] = True
                open_stretches += [(first, farthest), (farthest, last)]
        return Polyline(self.x_m[keep], self.y_m[keep])

    def reversed(self) -> Polyline:
        """The same curve driven the other way."""
        return Polyline(self.x_m[::-1].copy(), self.y_m[::-1].copy())

    def position(self, x_m: Array, y_m: Array) -> RoutePosition:
        """Where world points ``[points]`` lie relative to the polyline."""
        return route_position(x_m, y_m, self.x_m, self.y_m)


def bezier(x_m: Array, y_m: Array, count: int) -> Polyline:
    """Cubic Bezier curve of four control points, sampled at `count` + 1 equal parameters."""
    t = np.linspace(0.0, 1.0, count + 1)
    weights = ((1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t**3)
    x = sum(weight * value for weight, value in zip(weights, x_m, strict=True))
    y = sum(weight * value for weight, value in zip(weights, y_m, strict=True))
    return Polyline(np.asarray(x), np.asarray(y))


def join(parts: list[Polyline]) -> Polyline:
    """One polyline through parts that meet end to start; the shared vertices are kept once."""
    x = [parts[0].x_m, *(part.x_m[1:] for part in parts[1:])]
    y = [parts[0].y_m, *(part.y_m[1:] for part in parts[1:])]
    return Polyline(np.concatenate(x), np.concatenate(y))


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
