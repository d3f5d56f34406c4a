"""What sensors all round a vehicle tell of other road users and things: objects in range and in sight, with noise.

For an observation with the ego's centre ``p_e`` and heading ``psi_e``, and actor boxes of centres ``p_a``:

* in range where ``|p_a - p_e|^2 <= R^2``; of these the nearest `MAX_OBJECTS`, by distance and then by identity;
* in sight where the straight way from ``p_e`` to the centre or to a corner of its box runs through none of the others;
* measured in the frame of the ego, with the noise that `measured` adds.

Boxes stand for bodies of any height, and nothing else hides an object.
Everything follows from arithmetic that machines round alike, so that objects are equal in every bit.
Source: spec/12-model.md#objects; deviations are this project's choice.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.angle import cos_sin, wrap_rad
from branchdrive.driving.risk import RANGE_M

__all__ = [
    "EXTENT_SD", "MAX_OBJECTS", "NUM_VARIATES", "POSITION_SD_M", "VELOCITY_SD_MPS", "YAW_SD_RAD", "Bodies", "in_sight",
    "measured", "nearest",
]  # fmt: skip

MAX_OBJECTS = 32
"""Objects of an observation at most."""

POSITION_SD_M = 0.2
VELOCITY_SD_MPS = 0.3
YAW_SD_RAD = 0.03
EXTENT_SD = 0.05
"""Standard deviation of an extent, as a share of it."""

NUM_VARIATES = 7
"""Variates of a measurement: position, velocity, heading and extents."""

_POINTS = ((0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
"""Centre and corners of a box, in half extents along and across."""

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]


class Bodies(NamedTuple):
    """Actors as they are recorded, each field of one shape.

    Attributes:
        dx_m: Centre, from the ego's, in axes of the world.
        dy_m: The same.
        yaw_rad: Heading in the world.
        length_m: Full extent.
        width_m: Full extent.
        vel_x_mps: Velocity in the world.
        vel_y_mps: The same.
    """

    dx_m: Array
    dy_m: Array
    yaw_rad: Array
    length_m: Array
    width_m: Array
    vel_x_mps: Array
    vel_y_mps: Array

    def take(self, rows: Index | Mask | slice) -> Bodies:
        """The bodies at `rows`."""
        return Bodies(*(field[rows] for field in self))


def nearest(bodies: Bodies, moment: Index, identity: Index) -> tuple[Index, Index]:
    """Rows of the bodies in range, the nearest `MAX_OBJECTS` of each moment by distance, and their ranks in it.

    Args:
        bodies: Each field ``[n]``.
        moment: Moment of each, ascending ``[n]``.
        identity: Of each, no two of a moment alike ``[n]``.
    """
    square = bodies.dx_m * bodies.dx_m + bodies.dy_m * bodies.dy_m
    rows = np.flatnonzero(square <= RANGE_M * RANGE_M)
    rows = rows[np.lexsort((identity[rows], square[rows], moment[rows]))]
    own = moment[rows]
    rank = np.arange(len(rows)) - np.searchsorted(own, own, side="left")
    kept = rank < MAX_OBJECTS
    return rows[kept], rank[kept]


def in_sight(bodies: Bodies, moment: Index, rank: Index, num_moments: int) -> Mask:
    """Which bodies the ego's centre sees past the others of their moment ``[n]``.

    The way from the origin to a point ``p``, with middle and half ``p / 2``, runs through no box from which one of
    three axes separates it: the length of the box, its width, or the normal of the way.

    Args:
        bodies: As `nearest` chose them, each field ``[n]``.
        moment: Moment of each, from 0 ``[n]``.
        rank: Place of each in its moment, from 0 ``[n]``.
        num_moments: Number of the moments.
    """
    size = int(rank.max(initial=-1)) + 1

    def table(values: Array) -> Array:
        found = np.zeros((num_moments, size, *values.shape[1:]))
        found[moment, rank] = values
        return found

    cos, sin = cos_sin(bodies.yaw_rad)
    half_length, half_width = bodies.length_m / 2, bodies.width_m / 2
    points = [
        (bodies.dx_m + i * half_length * cos - j * half_width * sin,
         bodies.dy_m + i * half_length * sin + j * half_width * cos)
        for i, j in _POINTS
    ]  # fmt: skip
    half_x, half_y = (table(np.stack(parts, axis=-1) / 2)[..., None] for parts in zip(*points, strict=True))
    box_x, box_y, cos, sin, half_length, half_width = (
        table(values)[:, None, None]
        for values in (bodies.dx_m, bodies.dy_m, cos, sin, half_length, half_width)
    )  # fmt: skip
    is_there = table(np.ones(len(rank))) > 0
    others = is_there[:, None, None] & ~np.eye(size, dtype=bool)[None, :, None]
    middle_x, middle_y = half_x - box_x, half_y - box_y
    m_x, m_y = cos * middle_x + sin * middle_y, cos * middle_y - sin * middle_x
    d_x, d_y = cos * half_x + sin * half_y, cos * half_y - sin * half_x
    size_x, size_y = np.abs(d_x), np.abs(d_y)
    hides = np.abs(m_x) < half_length + size_x
    hides &= others
    hides &= np.abs(m_y) < half_width + size_y
    hides &= np.abs(d_x * m_y - d_y * m_x) < half_length * size_y + half_width * size_x
    is_hidden = np.logical_or.reduce(hides, axis=3)[moment, rank]
    return np.asarray(~np.logical_and.reduce(is_hidden, axis=1))


def measured(bodies: Bodies, ego_yaw_rad: Array, variates: Array) -> Bodies:
    """Bodies as they are measured, in the frame of the ego: velocities over ground along its axes.

    With the variates ``n_0 .. n_6``, the ego's heading ``psi_e`` and ``R(a)`` the rotation by ``a``::

        position = R(-psi_e) (p_a - p_e) + 0.2 m (n_0, n_1)       heading = wrap(psi_a - psi_e + 0.03 rad n_4)
        velocity = R(-psi_e) v_a + 0.3 m/s (n_2, n_3)             extents = l (1 + 0.05 n_5), w (1 + 0.05 n_6)

    Args:
        bodies: Each field ``[n]``.
        ego_yaw_rad: Heading of the ego at the moment of each ``[n]``.
        variates: Noise of each ``[n, NUM_VARIATES]``.
    """
    cos, sin = cos_sin(ego_yaw_rad)
    noise = variates.T
    return Bodies(
        cos * bodies.dx_m + sin * bodies.dy_m + POSITION_SD_M * noise[0],
        cos * bodies.dy_m - sin * bodies.dx_m + POSITION_SD_M * noise[1],
        wrap_rad(bodies.yaw_rad - ego_yaw_rad + YAW_SD_RAD * noise[4]),
        bodies.length_m * (1 + EXTENT_SD * noise[5]),
        bodies.width_m * (1 + EXTENT_SD * noise[6]),
        cos * bodies.vel_x_mps + sin * bodies.vel_y_mps + VELOCITY_SD_MPS * noise[2],
        cos * bodies.vel_y_mps - sin * bodies.vel_x_mps + VELOCITY_SD_MPS * noise[3],
    )
