"""The reference line of an OpenDRIVE road: places and headings by arc length.

Source: ASAM OpenDRIVE 1.8, chapter 9 (geometry of roads).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Cubic", "Curve", "ReferenceLine", "clothoid", "cubic_by_length", "parametric_cubic"]

Values = NDArray[np.float64]
Curve = Callable[[Values], tuple[Values, Values, Values]]
"""From arc lengths ``[points]`` to x and y in the frame of the curve's start, and to the heading there."""

Cubic = tuple[float, float, float, float]
"""``a + b p + c p^2 + d p^3``."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_PANEL_RAD = 1.0
"""Turn within which 16 nodes integrate sine and cosine of a quadratic to the last bits."""

_TABLE = 4097
"""Places at which the arc length of a cubic is known before it is inverted."""


def value(cubic: Cubic, p: Values) -> Values:
    """A cubic at `p`."""
    a, b, c, d = cubic
    return a + p * (b + p * (c + p * d))


def _slope(cubic: Cubic, p: Values) -> Values:
    _, b, c, d = cubic
    return b + p * (2 * c + p * 3 * d)


def clothoid(start_per_m: float, end_per_m: float, length_m: float) -> Curve:
    """A curve of linear curvature: a spiral, an arc where both ends are equal, a line where they are 0.

    ``theta(u) = k0 u + (k1 - k0) u^2 / (2 L)``, and ``x + i y`` is the integral of ``exp(i theta)`` from 0 to s.
    """
    change = (end_per_m - start_per_m) / length_m
    turn_rad = max(abs(start_per_m), abs(end_per_m)) * length_m
    panels = max(1, int(np.ceil(turn_rad / _PANEL_RAD)))

    def heading(u: Values) -> Values:
        return u * (start_per_m + u * change / 2)

    def curve(s_m: Values) -> tuple[Values, Values, Values]:
        half = s_m[:, None, None] / (2 * panels)
        middle = half * (2 * np.arange(panels)[:, None] + 1)
        theta = heading(middle + half * _NODES)
        x, y = ((half[..., 0] * (part(theta) * _WEIGHTS).sum(axis=2)).sum(axis=1) for part in (np.cos, np.sin))
        return x, y, heading(s_m)

    return curve


def parametric_cubic(u: Cubic, v: Cubic, scale: float) -> Curve:
    """Two cubics of ``p = s / scale``; the scale is 1, or the length where `p` runs from 0 to 1."""

    def curve(s_m: Values) -> tuple[Values, Values, Values]:
        p = s_m / scale
        return value(u, p), value(v, p), np.arctan2(_slope(v, p), _slope(u, p))

    return curve


def cubic_by_length(v: Cubic, length_m: float) -> Curve:
    """``v(u)`` at the `u` that has the arc length, which is found in a table of places."""
    u = np.linspace(0.0, length_m, _TABLE)  # the arc is no shorter than its u
    steps = np.hypot(np.diff(u), np.diff(value(v, u)))
    arc_m = np.concatenate([np.zeros(1), np.cumsum(steps)])

    def curve(s_m: Values) -> tuple[Values, Values, Values]:
        place = np.interp(s_m, arc_m, u)
        return place, value(v, place), np.arctan(_slope(v, place))

    return curve


@dataclass(frozen=True)
class ReferenceLine:
    """Curves one behind the other.

    Attributes:
        start: Of each curve: arc length, x, y and heading where it begins ``[curves, 4]``, in order of the first.
        curves: The curves.
    """

    start: Values
    curves: tuple[Curve, ...]

    def at(self, s_m: Values) -> tuple[Values, Values, Values]:
        """x, y and heading at arc lengths ``[points]``."""
        which = np.clip(np.searchsorted(self.start[:, 0], s_m, side="right") - 1, 0, None)
        found = np.empty((3, len(s_m)))
        for number in np.unique(which).tolist():
            here, (s, x, y, heading) = which == number, self.start[number]
            u, v, turned = self.curves[number](s_m[here] - s)
            found[:, here] = (
                x + u * np.cos(heading) - v * np.sin(heading),
                y + u * np.sin(heading) + v * np.cos(heading),
                heading + turned,
            )
        return found[0], found[1], found[2]

    def beside(self, s_m: Values, t_m: Values) -> tuple[Values, Values]:
        """Places `t_m` to the left of the line, at right angles to it."""
        x, y, heading = self.at(s_m)
        return x - t_m * np.sin(heading), y + t_m * np.cos(heading)
