"""Adapters from a simulator's frames and units to the recorded ones; each converts at the edge, once.

Recorded is a right-handed frame, x forward, y to the left, with radians counter-clockwise, and poses of box centres.
Commands need no adapter: steering is recorded positive to the right, whatever the frame.

Source: spec/02-time-frames-units.md#adapters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.angle import wrap_rad

__all__ = ["Frame", "box_centre", "full_extents"]

Real = TypeVar("Real", float, NDArray[np.float64])


@dataclass(frozen=True)
class Frame:
    """The frame of a simulator. Values are numbers or arrays; what comes out has their shape.

    Attributes:
        is_left_handed: Whether y points to the right and angles grow clockwise, seen from above, as in CARLA.
        is_degrees: Whether angles and rates are in degrees.
        is_compass: Whether headings are clockwise from north, as in SUMO and from GPS, where positions have x to the
            east and y to the north, or to the south in a left-handed frame. Where x points to the north and y to the
            east, headings are clockwise from x: that is a left-handed frame and no compass.
    """

    is_left_handed: bool = False
    is_degrees: bool = False
    is_compass: bool = False

    def vector(self, x: Real, y: Real) -> tuple[Real, Real]:
        """A position, route vertex or velocity."""
        return x, self.lateral(y)

    def lateral(self, value: Real) -> Real:
        """A quantity across a heading, such as a lateral acceleration: positive to the left."""
        return -value if self.is_left_handed else value

    def rate(self, value: Real) -> Real:
        """An angle that is not wrapped, or a yaw rate: radians, or radians per second, counter-clockwise."""
        rad = value * (np.pi / 180) if self.is_degrees else value
        return -rad if self.is_left_handed or self.is_compass else rad

    def yaw_rad(self, yaw: Real) -> Real:
        """A heading, wrapped to ``[-pi, pi]``."""
        wrapped = wrap_rad(self.rate(yaw) + (np.pi / 2 if self.is_compass else 0.0))
        return wrapped if isinstance(yaw, np.ndarray) else float(wrapped)


def box_centre(x_m: Real, y_m: Real, yaw_rad: Real, ahead_m: float, left_m: float = 0.0) -> tuple[Real, Real]:
    """Centre of a box, from the position that a simulator gives instead, both in the recorded frame.

    Args:
        x_m: Position, such as that of the rear axle.
        y_m: The same, y.
        yaw_rad: Heading.
        ahead_m: How far the centre lies ahead of the position, in the frame of the vehicle.
        left_m: How far it lies to the left.
    """
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return x_m + ahead_m * cos - left_m * sin, y_m + ahead_m * sin + left_m * cos


def full_extents(*half_m: float) -> tuple[float, ...]:
    """Full length, width and height of half ones."""
    return tuple(2 * half for half in half_m)
