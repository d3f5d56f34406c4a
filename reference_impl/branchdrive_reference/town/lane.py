"""Lanes: directed centre lines with their edges and neighbours.

Roads between junctions, and the lanes that lie on them. Traffic keeps to the right.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, IntEnum

import numpy as np

from branchdrive_reference.geometry.polyline import Polyline, bezier
from branchdrive_reference.town.crossroads import Crossroads

__all__ = [
    "LANE_WIDTH_M",
    "PARKING_WIDTH_M",
    "Carriageway",
    "Lane",
    "LaneSide",
    "Road",
    "RoadClass",
    "Turn",
    "carriageways",
]

LANE_WIDTH_M = 3.5
PARKING_WIDTH_M = 2.4
"""Width of a parking strip beyond the outermost lane."""


class LaneSide(IntEnum):
    """What lies beyond one edge of a lane."""

    NOTHING = 0
    SAME_DIRECTION = 1
    ONCOMING = 2
    PARKING = 3


class RoadClass(Enum):
    """What kind of road a lane belongs to."""

    STREET = "street"
    RURAL = "rural"
    MOTORWAY = "motorway"
    RAMP = "ramp"


class Turn(Enum):
    """What a lane does at a junction, and a route where it joins a motorway; values are navigation commands."""

    FOLLOW = "follow"
    LEFT = "left"
    STRAIGHT = "straight"
    RIGHT = "right"
    CHANGE_LEFT = "change_left"


@dataclass(frozen=True, eq=False)
class Lane:
    """A directed lane of a road, or a connector that crosses a junction.

    Attributes:
        lane_id: Identity in the town.
        way: Nodes it leads from and to; a connector's lie around the junction that it crosses.
        centre: Centre line in driving direction.
        width_m: Distance between the lane's edges.
        speed_limit_mps: Limit along the whole lane.
        road_class: Kind of its road; a connector has that of the road it leaves.
        turn: `Turn.FOLLOW` on a road, the manoeuvre on a connector.
        left: What lies beyond the left edge.
        right: What lies beyond the right edge.
        left_edge_m: Distance from the centre line to the left edge of the paved road.
        right_edge_m: Distance from the centre line to the right edge of the paved road.
        junction: Junction that a connector crosses or that a lane leads to; empty where there is none.
    """

    lane_id: str
    way: tuple[str, str]
    centre: Polyline
    width_m: float
    speed_limit_mps: float
    road_class: RoadClass
    turn: Turn
    left: LaneSide
    right: LaneSide
    left_edge_m: float
    right_edge_m: float
    junction: str = ""


_SAMPLE_STEP_M = 1.0


@dataclass(frozen=True)
class Road:
    """Declared road.

    Attributes:
        start: Junction where the first direction begins.
        end: Junction where it ends.
        lanes: Lanes in each direction.
        limit_kmh: Speed limit, kilometres per hour.
        bend_m: How far the control points at one and two thirds lie to the left of the chord:
            equal signs bend, opposite signs wind.
        parking: Whether a parking strip lies beyond the outermost lane of each direction.
        road_class: Street or rural road.
    """

    start: str
    end: str
    lanes: int
    limit_kmh: float
    bend_m: tuple[float, float] = (0.0, 0.0)
    parking: bool = False
    road_class: RoadClass = RoadClass.STREET


@dataclass(frozen=True, eq=False)
class Carriageway:
    """One direction of a road: lanes from the innermost (next to oncoming traffic) outwards."""

    start: str
    end: str
    lanes: tuple[Lane, ...]


def _centre_line(road: Road, junctions: Mapping[str, Crossroads]) -> Polyline:
    begin, end = junctions[road.start], junctions[road.end]
    (x0, y0), (x3, y3) = (begin.x_m, begin.y_m), (end.x_m, end.y_m)
    chord_x, chord_y = x3 - x0, y3 - y0
    chord = float(np.hypot(chord_x, chord_y))
    normal_x, normal_y = -chord_y / chord, chord_x / chord
    bend_1, bend_2 = road.bend_m
    curve = bezier(
        np.array([x0, x0 + chord_x / 3 + bend_1 * normal_x, x0 + 2 * chord_x / 3 + bend_2 * normal_x, x3]),
        np.array([y0, y0 + chord_y / 3 + bend_1 * normal_y, y0 + 2 * chord_y / 3 + bend_2 * normal_y, y3]),
        count=2 * round(chord),
    )
    return curve.cut(begin.radius_m, curve.length_m - end.radius_m)


def _lane(road: Road, start: str, end: str, index: int, centre: Polyline) -> Lane:
    """Lane `index` of one direction, whose road centre line runs the same way."""
    outwards_m = (index + 0.5) * LANE_WIDTH_M
    paved_m = road.lanes * LANE_WIDTH_M + (PARKING_WIDTH_M if road.parking else 0.0)
    beside = LaneSide.PARKING if road.parking else LaneSide.NOTHING
    return Lane(
        lane_id=f"{start}-{end}:{index}",
        way=(start, end),
        centre=centre.shifted(-outwards_m).resampled(_SAMPLE_STEP_M),
        width_m=LANE_WIDTH_M,
        speed_limit_mps=road.limit_kmh / 3.6,
        road_class=road.road_class,
        turn=Turn.FOLLOW,
        left=LaneSide.ONCOMING if index == 0 else LaneSide.SAME_DIRECTION,
        right=beside if index == road.lanes - 1 else LaneSide.SAME_DIRECTION,
        left_edge_m=paved_m + outwards_m,
        right_edge_m=paved_m - outwards_m,
        junction=end,
    )


def carriageways(road: Road, junctions: Mapping[str, Crossroads]) -> tuple[Carriageway, Carriageway]:
    """Both directions of a road."""
    centre = _centre_line(road, junctions)
    directions = ((road.start, road.end, centre), (road.end, road.start, centre.reversed()))
    forward, backward = (
        Carriageway(start, end, tuple(_lane(road, start, end, index, line) for index in range(road.lanes)))
        for start, end, line in directions
    )
    return forward, backward
