"""Motorways: two one-way carriageways of several lanes along one axis, and the ramps that join and leave them.

A carriageway is cut where a ramp joins or leaves, so that lanes follow each other end to end. A ramp is its
outermost lane's centre line, shifted to the right by a profile: an entry comes in from the side, runs along as an
acceleration lane, and tapers into the lane; an exit is the mirror image of an entry.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from branchdrive_reference.geometry.polyline import Array, Polyline
from branchdrive_reference.town.lane import LANE_WIDTH_M, Lane, LaneSide, RoadClass, Turn

__all__ = ["SHOULDER_M", "TAPER_M", "Motorway", "MotorwayLanes", "motorway_lanes"]

SHOULDER_M = 2.5
"""Width of the paved shoulder beyond the outermost lane."""

_MEDIAN_M = 6.0
_SAMPLE_STEP_M = 1.0
_APPROACH_M, _PARALLEL_M, TAPER_M = 170.0, 130.0, 70.0
"""Lengths of an entry: coming in from the side, alongside the outermost lane, and moving over into it."""

_RAMP_LENGTH_M = _APPROACH_M + _PARALLEL_M + TAPER_M

_ASIDE_M = 34.0
"""How far from the lane an entry begins."""


@dataclass(frozen=True)
class Motorway:
    """Declared motorway; positions are arc lengths of the axis, in the direction of the first carriageway.

    Attributes:
        name: Prefix of its nodes and lanes.
        axis_m: Points ``(x, y)`` that the axis passes, in the world frame.
        lanes: Lanes in each direction.
        limit_kmh: Speed limit of the lanes.
        ramp_limit_kmh: Speed limit of the ramps.
        entries_m: Where entries of the forward carriageway have joined.
        exits_m: Where exits of the forward carriageway leave.
        back_entries_m: The same for the backward carriageway, in its own direction.
        back_exits_m: The same for the backward carriageway, in its own direction.
    """

    name: str
    axis_m: tuple[tuple[float, float], ...]
    lanes: int
    limit_kmh: float
    ramp_limit_kmh: float
    entries_m: tuple[float, ...] = ()
    exits_m: tuple[float, ...] = ()
    back_entries_m: tuple[float, ...] = ()
    back_exits_m: tuple[float, ...] = ()


@dataclass(frozen=True)
class MotorwayLanes:
    """Lanes of a motorway.

    Attributes:
        lanes: Every lane, carriageways first, innermost lanes first.
        links: Pairs of lane ids that follow each other directly.
    """

    lanes: tuple[Lane, ...]
    links: tuple[tuple[str, str], ...]


def _spline(points: tuple[tuple[float, float], ...]) -> Polyline:
    """Centripetal-free Catmull-Rom curve through the points, sampled about every metre."""
    knots = np.array(points)
    knots = np.vstack([2 * knots[0] - knots[1], knots, 2 * knots[-1] - knots[-2]])
    parts = []
    for index in range(1, len(knots) - 2):
        before, begin, end, after = knots[index - 1 : index + 3]
        t = np.linspace(0.0, 1.0, max(2, round(math.dist(begin, end))), endpoint=False)[:, None]
        parts.append(
            begin
            + 0.5 * t * (end - before)
            + t**2 * (before - 2.5 * begin + 2 * end - 0.5 * after)
            + t**3 * (1.5 * (begin - end) + 0.5 * (after - before))
        )
    curve = np.vstack([*parts, knots[-2:-1]])
    return Polyline(curve[:, 0].copy(), curve[:, 1].copy())


def _ease(share: Array) -> Array:
    return 0.5 - 0.5 * np.cos(np.pi * np.clip(share, 0.0, 1.0))


def _entry(lane: Polyline, joins_m: float) -> Polyline:
    """An entry that ends on `lane` at arc length `joins_m`."""
    along = lane.cut(joins_m - _RAMP_LENGTH_M, joins_m).resampled(_SAMPLE_STEP_M)
    arc = along.arc_m
    aside = (_ASIDE_M - LANE_WIDTH_M) * (1.0 - _ease(arc / _APPROACH_M))
    aside += LANE_WIDTH_M * (1.0 - _ease((arc - _APPROACH_M - _PARALLEL_M) / TAPER_M))
    tangent = along.tangent_rad
    shifted = Polyline(along.x_m + aside * np.sin(tangent), along.y_m - aside * np.cos(tangent))
    return shifted.resampled(_SAMPLE_STEP_M)


def _exit(lane: Polyline, leaves_m: float) -> Polyline:
    """An exit that begins on `lane`, the mirror image of an entry driven backwards."""
    mirrored = Polyline(lane.x_m, -lane.y_m).reversed()
    ramp = _entry(mirrored, lane.length_m - leaves_m)
    return Polyline(ramp.x_m, -ramp.y_m).reversed()


def _pieces(motorway: Motorway, direction: str, axis: Polyline, cuts_m: list[float]) -> Iterator[tuple[int, Lane]]:
    """Lanes of one carriageway with the number of their piece, innermost first."""
    bounds = [0.0, *cuts_m, axis.length_m]
    for index in range(motorway.lanes):
        outwards_m = _MEDIAN_M / 2 + (index + 0.5) * LANE_WIDTH_M
        inner_m = (index + 0.5) * LANE_WIDTH_M
        outer_m = (motorway.lanes - index - 0.5) * LANE_WIDTH_M + SHOULDER_M
        for piece, (begin_m, end_m) in enumerate(pairwise(bounds)):
            yield (
                piece,
                Lane(
                    lane_id=f"{motorway.name}{direction}{piece}:{index}",
                    way=(f"{motorway.name}{direction}{piece}", f"{motorway.name}{direction}{piece + 1}"),
                    centre=axis.cut(begin_m, end_m).shifted(-outwards_m).resampled(_SAMPLE_STEP_M),
                    width_m=LANE_WIDTH_M,
                    speed_limit_mps=motorway.limit_kmh / 3.6,
                    road_class=RoadClass.MOTORWAY,
                    turn=Turn.FOLLOW,
                    left=LaneSide.NOTHING if index == 0 else LaneSide.SAME_DIRECTION,
                    right=LaneSide.NOTHING if index == motorway.lanes - 1 else LaneSide.SAME_DIRECTION,
                    left_edge_m=inner_m,
                    right_edge_m=outer_m,
                ),
            )


def _ramp(motorway: Motorway, lane_id: str, way: tuple[str, str], centre: Polyline) -> Lane:
    return Lane(
        lane_id, way, centre, LANE_WIDTH_M, motorway.ramp_limit_kmh / 3.6, RoadClass.RAMP, Turn.FOLLOW,
        LaneSide.NOTHING, LaneSide.NOTHING, LANE_WIDTH_M / 2, LANE_WIDTH_M / 2 + SHOULDER_M,
    )  # fmt: skip


def _carriageway(
    motorway: Motorway, direction: str, axis: Polyline, entries_m: tuple[float, ...], exits_m: tuple[float, ...]
) -> MotorwayLanes:
    cuts_m = sorted((*entries_m, *exits_m))
    pieces = list(_pieces(motorway, direction, axis, cuts_m))
    last = len(cuts_m)
    outermost = motorway.lanes - 1
    name = f"{motorway.name}{direction}"
    links = [
        (f"{name}{piece}:{index}", f"{name}{piece + 1}:{index}")
        for index in range(motorway.lanes)
        for piece in range(last)
    ]
    whole = axis.shifted(-(_MEDIAN_M / 2 + (outermost + 0.5) * LANE_WIDTH_M))
    ramps = []
    for piece, cut_m in enumerate(cuts_m):
        x, y = axis.at(np.array([cut_m]))
        heading = float(np.interp(cut_m, axis.arc_m, axis.tangent_rad))
        aside_m = _MEDIAN_M / 2 + (outermost + 0.5) * LANE_WIDTH_M
        foot = whole.position(x + aside_m * math.sin(heading), y - aside_m * math.cos(heading))
        place_m = float(foot.progress_m[0])
        if cut_m in entries_m:
            lane_id = f"{name}-on{piece}:0"
            ramps.append(_ramp(motorway, lane_id, (f"{name}-on{piece}", f"{name}{piece + 1}"), _entry(whole, place_m)))
            links.append((lane_id, f"{name}{piece + 1}:{outermost}"))
        else:
            lane_id = f"{name}-off{piece}:0"
            ramps.append(_ramp(motorway, lane_id, (f"{name}{piece + 1}", f"{name}-off{piece}"), _exit(whole, place_m)))
            links.append((f"{name}{piece}:{outermost}", lane_id))
    return MotorwayLanes((*(lane for _, lane in pieces), *ramps), tuple(links))


def motorway_lanes(motorway: Motorway) -> MotorwayLanes:
    """All lanes of a motorway: forward ``f`` and backward ``b`` carriageway."""
    axis = _spline(motorway.axis_m)
    forward = _carriageway(motorway, "f", axis, motorway.entries_m, motorway.exits_m)
    backward = _carriageway(motorway, "b", axis.reversed(), motorway.back_entries_m, motorway.back_exits_m)
    return MotorwayLanes(forward.lanes + backward.lanes, forward.links + backward.links)
