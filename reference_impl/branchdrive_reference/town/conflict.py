"""Conflicts: where two tracks of a route cross or merge, and whose traffic yields there.

Inside a junction two tracks conflict where their centre lines come closer than a vehicle is wide. Who yields
follows from signals and signs: at signals a left turn yields to who comes from the opposite side; elsewhere minor
approaches yield to major ones, left turns to the opposite side, and between equals the right goes first.
An entry and the lane that it joins merge like a zipper: who is nearer to the join goes first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from branchdrive_reference.geometry.box import wrap
from branchdrive_reference.geometry.polyline import Array
from branchdrive_reference.town.lane import Turn
from branchdrive_reference.town.signal import NO_GROUP

__all__ = ["CONFLICT", "OPPOSITE_RAD", "TrackCourse", "conflict_table"]

CONFLICT = np.dtype(
    [
        ("track", np.int64),
        ("other", np.int64),
        ("yields", np.int64),  # whether the traffic of `track` yields to that of `other`
        ("enter_m", np.float64),  # arc lengths between which the centre of a vehicle is in the way
        ("leave_m", np.float64),
        ("other_enter_m", np.float64),
        ("other_leave_m", np.float64),
        ("zipper", np.int64),  # whether the two merge like a zipper; then there is a row for either side
    ],
    align=True,
)
"""One conflict, seen from one of its two sides."""

_CLEARANCE_M = 2.6
_BEYOND_M = 5.0
"""Tracks that end on the same lane count as in conflict this far beyond the junction."""

OPPOSITE_RAD, _SAME_RAD = math.radians(135.0), math.radians(20.0)
"""Approaches that differ by more than the first face each other, by less than the second they are one."""


@dataclass(frozen=True)
class TrackCourse:
    """How a track crosses the junction of its route.

    Attributes:
        begin_m: Arc length where it enters; infinite if it does not.
        end_m: Arc length where it leaves.
        group: Signal group of its approach, `NO_GROUP` without signals.
        stops: Whether its approach has a stop sign.
        turn: Manoeuvre.
        major: Whether its approach has priority, or signals.
    """

    begin_m: float
    end_m: float
    group: int
    stops: bool
    turn: Turn
    major: bool = True


def _yields(own: TrackCourse, other: TrackCourse, turned_rad: float) -> bool:
    """Whether `own` yields, where the other approach's direction is `turned_rad` counter-clockwise from its own."""
    if own.group != other.group:
        return False
    opposite = abs(turned_rad) > OPPOSITE_RAD
    if own.group == NO_GROUP and own.major != other.major:
        return other.major
    if opposite:
        return own.turn is Turn.LEFT and other.turn is not Turn.LEFT
    return own.group == NO_GROUP and turned_rad > 0  # it comes from the right


def _inside(path: NDArray[np.void], course: TrackCourse) -> NDArray[np.intp]:
    arc = path["arc_m"]
    return np.flatnonzero((arc >= course.begin_m) & (arc <= course.end_m + _BEYOND_M))


def _interval(arc_m: Array) -> tuple[float, float]:
    return float(arc_m.min()), float(arc_m.max())


def _crossings(paths: list[NDArray[np.void]], courses: list[TrackCourse]) -> Iterator[tuple[float, ...]]:
    for own in range(len(paths)):
        for other in range(len(paths)):
            if own == other or np.isinf(courses[own].begin_m) or np.isinf(courses[other].begin_m):
                continue
            a, b = _inside(paths[own], courses[own]), _inside(paths[other], courses[other])
            pa, pb = paths[own][a], paths[other][b]
            near = np.hypot(pa["x_m"][:, None] - pb["x_m"], pa["y_m"][:, None] - pb["y_m"]) < _CLEARANCE_M
            turned = wrap(float(pb["tangent_rad"][0] - pa["tangent_rad"][0]))
            if near.any() and abs(turned) > _SAME_RAD:  # lanes of one approach never cross
                yields = _yields(courses[own], courses[other], turned)
                enter_m, leave_m = _interval(pa["arc_m"][near.any(axis=1)])
                other_m, other_leave_m = _interval(pb["arc_m"][near.any(axis=0)])
                yield own, other, yields, enter_m, leave_m, other_m, other_leave_m, 0


def _zipper(paths: list[NDArray[np.void]], own: int, other: int) -> Iterator[tuple[float, ...]]:
    """Both rows of a merge: from where the tracks come closer than a vehicle is wide to the end of the join."""
    pa, pb = paths[own], paths[other]
    gap = np.hypot(pa["x_m"][:, None] - pb["x_m"], pa["y_m"][:, None] - pb["y_m"])
    first = int(np.flatnonzero(gap.min(axis=1) < _CLEARANCE_M)[0])
    enter_m, other_m = float(pa["arc_m"][first]), float(pb["arc_m"][gap[first].argmin()])
    joined = int(np.flatnonzero(gap.min(axis=1) < 0.05)[0])
    leave_m, other_leave_m = float(pa["arc_m"][joined]), float(pb["arc_m"][gap[joined].argmin()])
    yield own, other, 1, enter_m, leave_m, other_m, other_leave_m, 1
    yield other, own, 1, other_m, other_leave_m, enter_m, leave_m, 1


def conflict_table(
    paths: list[NDArray[np.void]], courses: list[TrackCourse], *, merging: tuple[int, int] | None
) -> NDArray[np.void]:
    """`CONFLICT` rows of the tracks with these `VERTEX` tables and courses; `merging` names a zipper's two sides."""
    rows = list(_crossings(paths, courses))
    if merging is not None:
        rows += _zipper(paths, *merging)
    return np.array(rows, CONFLICT)
