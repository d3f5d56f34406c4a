"""Junctions: connectors from the lanes that arrive to the lanes that leave.

Left turns join the innermost lanes, right turns the outermost, and straight connectors keep the
lane index, so that no two connectors of one carriageway cross.
"""

from __future__ import annotations

import math

import numpy as np

from branchdrive_reference.geometry.angle import wrap
from branchdrive_reference.geometry.polyline import Polyline, bezier
from branchdrive_reference.town.lane import Lane, LaneSide, Turn
from branchdrive_reference.town.road import Carriageway

__all__ = ["Connector", "connectors"]

_STRAIGHT_RAD = math.radians(40.0)
_SAMPLE_STEP_M = 1.0

Connector = tuple[str, Lane, str]
"""Arriving lane id, connecting lane, leaving lane id."""


def _turn(turn_rad: float) -> Turn:
    if abs(turn_rad) < _STRAIGHT_RAD:
        return Turn.STRAIGHT
    return Turn.LEFT if turn_rad > 0 else Turn.RIGHT


def _curve(arriving: Polyline, leaving: Polyline) -> Polyline:
    """Bezier curve close to a circular arc: handles of ``4/3 tan(turn/4) R``, ``chord = 2 R sin(turn/2)``."""
    heading_0, heading_1 = float(arriving.tangent_rad[-1]), float(leaving.tangent_rad[0])
    x0, y0 = float(arriving.x_m[-1]), float(arriving.y_m[-1])
    x3, y3 = float(leaving.x_m[0]), float(leaving.y_m[0])
    chord, turn = math.hypot(x3 - x0, y3 - y0), abs(wrap(heading_1 - heading_0))
    handle = chord / 3 if turn < 1e-3 else 4 / 3 * math.tan(turn / 4) * chord / (2 * math.sin(turn / 2))
    curve = bezier(
        np.array([x0, x0 + handle * math.cos(heading_0), x3 - handle * math.cos(heading_1), x3]),
        np.array([y0, y0 + handle * math.sin(heading_0), y3 - handle * math.sin(heading_1), y3]),
        count=128,
    )
    return curve.resampled(_SAMPLE_STEP_M)


def _lane_pairs(arriving: Carriageway, leaving: Carriageway, turn: Turn) -> list[tuple[Lane, Lane]]:
    match turn:
        case Turn.LEFT:
            return [(arriving.lanes[0], leaving.lanes[0])]
        case Turn.RIGHT:
            return [(arriving.lanes[-1], leaving.lanes[-1])]
        case _:
            return list(zip(arriving.lanes, leaving.lanes, strict=False))


def connectors(arriving: Carriageway, leaving: Carriageway, radius_m: float) -> list[Connector]:
    """Connectors between two carriageways that meet at a junction of a radius; none for a U-turn."""
    if arriving.start == leaving.end:
        return []
    heading = arriving.lanes[0].centre.tangent_rad[-1]
    turn = _turn(wrap(float(leaving.lanes[0].centre.tangent_rad[0] - heading)))
    return [
        (
            lane_in.lane_id,
            Lane(
                lane_id=f"{arriving.start}-{arriving.end}-{leaving.end}:{arriving.lanes.index(lane_in)}",
                way=(arriving.start, leaving.end),
                centre=_curve(lane_in.centre, lane_out.centre),
                width_m=lane_in.width_m,
                speed_limit_mps=min(lane_in.speed_limit_mps, lane_out.speed_limit_mps),
                road_class=lane_in.road_class,
                turn=turn,
                left=LaneSide.NOTHING,
                right=LaneSide.NOTHING,
                left_edge_m=radius_m,
                right_edge_m=radius_m,
                junction=arriving.end,
            ),
            lane_out.lane_id,
        )
        for lane_in, lane_out in _lane_pairs(arriving, leaving, turn)
    ]
