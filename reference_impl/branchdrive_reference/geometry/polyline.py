"""Polylines with arc length: construction by numpy, exact foot points, resampling and offsets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Polyline", "RoutePosition", "bezier", "join"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RoutePosition:
    """Points relative to a polyline, each field ``[points]``.

    Attributes:
        progress_m: Arc length of the foot point.
        offset_m: Distance from the polyline, positive to the left of its direction.
        heading_rad: Direction of the segment that holds the foot point.
    """

    progress_m: Array
    offset_m: Array
    heading_rad: Array


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

    def shifted(self, left_m: float) -> Polyline:
        """The parallel curve `left_m` to the left of every vertex."""
        tangent = self.tangent_rad
        return Polyline(self.x_m - left_m * np.sin(tangent), self.y_m + left_m * np.cos(tangent))

    def reversed(self) -> Polyline:
        """The same curve driven the other way."""
        return Polyline(self.x_m[::-1].copy(), self.y_m[::-1].copy())

    def position(self, x_m: Array, y_m: Array) -> RoutePosition:
        """Nearest foot points of world points ``[points]``; the first segment wins a tie.

        For a segment from ``a`` with vector ``e``: ``t = clip((p - a) . e / |e|^2, 0, 1)``, and the
        offset carries the sign of ``e x (p - a)``.
        """
        ex, ey = np.diff(self.x_m), np.diff(self.y_m)
        square = ex * ex + ey * ey
        px, py = x_m[:, None] - self.x_m[None, :-1], y_m[:, None] - self.y_m[None, :-1]
        along = np.clip((px * ex + py * ey) / square, 0.0, 1.0)
        distance = np.hypot(px - along * ex, py - along * ey)
        best = distance.argmin(axis=1)
        row = np.arange(len(best))
        side = np.where(ex[best] * py[row, best] - ey[best] * px[row, best] < 0, -1.0, 1.0)
        progress = self.arc_m[best] + along[row, best] * np.sqrt(square[best])
        return RoutePosition(progress, side * distance[row, best], np.arctan2(ey, ex)[best])


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
