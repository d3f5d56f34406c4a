"""Lanes: directed centre lines with their edges and neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

from branchdrive_reference.geometry.polyline import Polyline

__all__ = ["LANE_WIDTH_M", "PARKING_WIDTH_M", "Lane", "LaneSide", "RoadClass", "Turn"]

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
