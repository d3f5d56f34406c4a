"""Oriented boxes in the plane: gap and line between closest points.

Two convex polygons that do not overlap are closest at a vertex of one of them, so the gap is the
smallest distance from the four corners of each box to the other box. Overlap is decided by the
separating-axis theorem. Source: spec/05-raw-streams.md#evidence.

Lower bounds on gap and time to collision that need no box arithmetic.

With ``D`` the vector between the centres of two boxes, ``h`` the sum of their half diagonals, ``v``
their relative velocity, and ``g n`` the vector between their closest points (gap ``g``, unit vector
``n``, closing speed ``c = -v . n``), no closest point is further than a half diagonal from its centre::

    |g n - D| <= h
    g          >= |D| - h
    c g = -v . g n <= |v| h - v . D =: p
    g / c = g^2 / (c g) >= max(|D| - h, 0)^2 / p      c <= 0 where p <= 0

Source: spec/05-raw-streams.md#evidence.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["BoxGap", "Boxes", "PairBounds", "box_gap", "pair_bounds"]

Array = NDArray[np.float64]


class Boxes(NamedTuple):
    """Oriented boxes, each field ``[n]`` float64: centre and heading in one frame, full extents in metres."""

    x_m: Array
    y_m: Array
    yaw_rad: Array
    length_m: Array
    width_m: Array

    def take(self, rows: NDArray[np.intp] | slice) -> Boxes:
        """The boxes at `rows`."""
        return Boxes(*(field[rows] for field in self))


class BoxGap(NamedTuple):
    """Gap between pairs of boxes, each field ``[n]``.

    ``normal`` is the unit vector from the first box's closest point to the second's, in the frame
    of the boxes; zero on overlap, where the gap is 0.
    """

    gap_m: Array
    normal_x: Array
    normal_y: Array


class _Corner(NamedTuple):
    """The corner of a box that is closest to another box, each field ``[n]``: squared distance, and the way there."""

    square: Array
    x: Array
    y: Array


def _closest_corner(
    x: Array, y: Array, along: tuple[Array, Array], across: tuple[Array, Array], half_length: Array, half_width: Array
) -> _Corner:
    """Closest corner of boxes to axis-aligned boxes at the origin.

    Args:
        x: Centre of the boxes with corners.
        y: Centre of the boxes with corners.
        along: Their half lengths as vectors.
        across: Their half widths as vectors.
        half_length: Half extent of the boxes at the origin.
        half_width: Half extent of the boxes at the origin.
    """

    def corner_at(corner_x: Array, corner_y: Array) -> _Corner:
        to_x = corner_x - np.minimum(np.maximum(corner_x, -half_length), half_length)
        to_y = corner_y - np.minimum(np.maximum(corner_y, -half_width), half_width)
        return _Corner(to_x * to_x + to_y * to_y, to_x, to_y)

    front_x, front_y = along[0] + across[0], along[1] + across[1]
    rear_x, rear_y = along[0] - across[0], along[1] - across[1]
    closest = corner_at(x + front_x, y + front_y)
    for reach_x, reach_y in ((-front_x, -front_y), (rear_x, rear_y), (-rear_x, -rear_y)):
        corner = corner_at(x + reach_x, y + reach_y)
        closer = corner.square < closest.square
        closest = _Corner(*(np.where(closer, *values) for values in zip(corner, closest, strict=True)))
    return closest


def box_gap(a: Boxes, b: Boxes) -> BoxGap:
    """Smallest distance between paired boxes `a` and `b`, metres, 0 where they overlap or touch."""
    cos_a, sin_a = np.cos(a.yaw_rad), np.sin(a.yaw_rad)
    cos_r, sin_r = np.cos(b.yaw_rad - a.yaw_rad), np.sin(b.yaw_rad - a.yaw_rad)
    dx, dy = b.x_m - a.x_m, b.y_m - a.y_m
    # Everything below lives in the frame of `a`; (u, v) is the centre of `b` there.
    u, v = cos_a * dx + sin_a * dy, cos_a * dy - sin_a * dx
    la, wa, lb, wb = a.length_m / 2, a.width_m / 2, b.length_m / 2, b.width_m / 2
    u_b, v_b = cos_r * u + sin_r * v, cos_r * v - sin_r * u  # the same offset along the axes of `b`

    of_b = _closest_corner(u, v, (cos_r * lb, sin_r * lb), (-sin_r * wb, cos_r * wb), la, wa)
    of_a = _closest_corner(-u_b, -v_b, (cos_r * la, -sin_r * la), (sin_r * wa, cos_r * wa), lb, wb)
    from_a = of_b.square <= of_a.square
    # The way to a corner of `a`, seen from `b`, is the way from `a` to `b` reversed.
    to_x = np.where(from_a, of_b.x, sin_r * of_a.y - cos_r * of_a.x)
    to_y = np.where(from_a, of_b.y, -sin_r * of_a.x - cos_r * of_a.y)

    reach_c, reach_s = np.abs(cos_r), np.abs(sin_r)
    separated = (
        (np.abs(u) > la + lb * reach_c + wb * reach_s)
        | (np.abs(v) > wa + lb * reach_s + wb * reach_c)
        | (np.abs(u_b) > lb + la * reach_c + wa * reach_s)
        | (np.abs(v_b) > wb + la * reach_s + wa * reach_c)
    )
    gap = np.where(separated, np.hypot(to_x, to_y), 0.0)
    nx, ny = (np.divide(to, gap, out=np.zeros_like(gap), where=gap > 0) for to in (to_x, to_y))
    return BoxGap(gap, cos_a * nx - sin_a * ny, sin_a * nx + cos_a * ny)


_ROUNDING = 1e-5
"""Relative error that rounding to single precision stays below, here and where the quantities are computed."""


class PairBounds(NamedTuple):
    """Lower bounds of pairs in single precision, each field ``[pairs]``; NaN, where nothing is known, bounds nothing.

    Attributes:
        gap_m: At most the gap, negative where boxes may overlap.
        ttc_s: At most gap over closing speed, ``inf`` where they cannot close; where they may overlap, 0 or NaN.
    """

    gap_m: NDArray[np.float32]
    ttc_s: NDArray[np.float32]


@np.errstate(all="ignore")  # a bound beyond all numbers is infinity
def pair_bounds(
    offset_x_m: Array, offset_y_m: Array, reach_m: NDArray[np.floating[Any]], rel_x_mps: Array, rel_y_mps: Array
) -> PairBounds:
    """Bounds from ``D`` (second centre minus first), ``h`` and ``v`` (second velocity minus first)."""
    off_x, off_y, reach, rel_x, rel_y = (
        values.astype(np.float32, copy=False) for values in (offset_x_m, offset_y_m, reach_m, rel_x_mps, rel_y_mps)
    )
    distance = np.sqrt(off_x * off_x + off_y * off_y)
    speed = np.sqrt(rel_x * rel_x + rel_y * rel_y)
    error = np.float32(_ROUNDING) * (distance + reach)
    gap = distance - reach - error
    power = speed * (reach + error) - (rel_x * off_x + rel_y * off_y)
    apart = np.maximum(gap, 0)
    return PairBounds(gap, apart * apart / np.maximum(power, 0))
