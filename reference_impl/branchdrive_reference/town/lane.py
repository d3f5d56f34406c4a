"""Lanes: directed centre lines with their edges and neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

from branchdrive_reference.geometry.polyline import Polyline

__all__ = ["Lane", "LaneSide", "Turn"]


class LaneSide(IntEnum):
    """What lies beyond one edge of a lane."""

    NOTHING = 0
    SAME_DIRECTION = 1
    ONCOMING = 2


class Turn(Enum):
    """What a lane does at a junction; values are navigation commands."""

    FOLLOW = "follow"
    LEFT = "left"
    STRAIGHT = "straight"
    RIGHT = "right"


@dataclass(frozen=True, eq=False)
class Lane:
    """A directed lane of a road, or a connector that crosses a junction.

    Attributes:
        lane_id: Identity in the town.
        way: Junctions it leads from and to; a connector's lie around the one it crosses.
        centre: Centre line in driving direction.
        width_m: Distance between the lane's edges.
        speed_limit_mps: Limit along the whole lane.
        turn: `Turn.FOLLOW` on a road, the manoeuvre on a connector.
        left: What lies beyond the left edge.
        right: What lies beyond the right edge.
        left_edge_m: Distance from the centre line to the left edge of the carriageway.
        right_edge_m: Distance from the centre line to the right edge of the carriageway.
    """

    lane_id: str
    way: tuple[str, str]
    centre: Polyline
    width_m: float
    speed_limit_mps: float
    turn: Turn
    left: LaneSide
    right: LaneSide
    left_edge_m: float
    right_edge_m: float
