"""The cut-out that a map shows: turned so that the ego drives to the right at the branch.

View frame: origin in the ego's centre at the branch tick, u along its heading, v to its left, metres.

What lies over what in the map of a picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from branchdrive_reference.drawing.scene import Array, Candidate, DrawnScene

__all__ = ["Layer", "View", "view_of"]

_LEAST_WIDTH_M = 75.0
_MOST_WIDTH_M = 105.0
"""Touches and the nearest actor come into view as long as the view stays narrower."""

_MARGIN_M = 7.0
_HISTORY_S = 2.0
"""History that is always in view; of the rest there is what fits."""

_AHEAD = 0.6
"""Share of the spare width that goes ahead."""


@dataclass(frozen=True)
class View:
    """A turned frame and the rectangle of it that is shown.

    Attributes:
        x_m: Origin, world frame.
        y_m: Origin, world frame.
        heading_rad: Direction of u in the world.
        u_m: Shown range of u.
        v_m: Shown range of v.
    """

    x_m: float
    y_m: float
    heading_rad: float
    u_m: tuple[float, float]
    v_m: tuple[float, float]

    def place(self, x_m: Array, y_m: Array) -> tuple[Array, Array]:
        """World points in the view frame, same shapes."""
        return _turned(x_m - self.x_m, y_m - self.y_m, self.heading_rad)

    def angle(self, yaw_rad: float) -> float:
        """A world direction in the view frame."""
        return yaw_rad - self.heading_rad

    def sees(self, u_m: Array, v_m: Array, margin_m: float = 0.0) -> bool:
        """Whether the box around points of the view frame meets the rectangle."""
        (left, right), (low, high) = self.u_m, self.v_m
        beside = u_m.max() < left - margin_m or u_m.min() > right + margin_m
        return not (beside or v_m.max() < low - margin_m or v_m.min() > high + margin_m)


def _turned(x: Array, y: Array, heading_rad: float) -> tuple[Array, Array]:
    cos, sin = math.cos(heading_rad), math.sin(heading_rad)
    return cos * x + sin * y, cos * y - sin * x


def view_of(scene: DrawnScene, *, aspect: float) -> View:
    """The view that holds every future, and what comes of them as far as it is near; at least 75 m wide.

    Args:
        scene: What is shown.
        aspect: Width of the rectangle by its height.
    """
    row, nominal = scene.branch_row, scene.nominal
    x, y, heading = (float(values[row]) for values in (nominal.x_m, nominal.y_m, nominal.yaw_rad))

    def placed(candidate: Candidate, rows: NDArray[np.bool_] | NDArray[np.int64]) -> Array:
        return np.stack(_turned(candidate.x_m[rows] - x, candidate.y_m[rows] - y, heading), axis=1)

    needed = [
        placed(candidate, candidate.future | (candidate.history & (candidate.time_s >= -_HISTORY_S)))
        for candidate in scene.candidates
    ]
    wanted = [placed(candidate, candidate.contacts[:1]) for candidate in scene.candidates]
    wanted += [
        np.stack(_turned(actor.x_m[[0, -1]] - x, actor.y_m[[0, -1]] - y, heading), axis=1)
        for actor in scene.actors
        if actor.actor_id == scene.nearest_actor_id
    ]
    points = np.concatenate(needed)
    for more in wanted:
        extended = np.concatenate([points, more])
        if _width_m(extended, aspect) <= _MOST_WIDTH_M:
            points = extended
    width = max(_width_m(points, aspect), _LEAST_WIDTH_M)
    spare = width - float(np.ptp(points[:, 0]))
    left = float(points[:, 0].min()) - (1 - _AHEAD) * spare
    low = float(points[:, 1].min() + points[:, 1].max() - width / aspect) / 2
    return View(x, y, heading, (left, left + width), (low, low + width / aspect))


def _width_m(points: Array, aspect: float) -> float:
    """Width of the rectangle around points ``[points, 2]`` with a margin."""
    u, v = np.ptp(points, axis=0) + 2 * _MARGIN_M
    return float(max(u, aspect * v))


class Layer(IntEnum):
    """Drawing order, the lowest first."""

    GROUND = 0
    PAVED = 1
    CARRIAGEWAY = 2
    MARKING = 3
    ROUTE = 4
    GHOST = 5
    ACTOR = 6
    HISTORY = 7
    RECOVERY = 8
    FUTURE = 9
    EGO = 10
    END = 11
    CONTACT = 12
    NOTE = 13
