"""The road network: every lane of a town and how lanes follow each other.

Junctions: connectors from the lanes that arrive to the lanes that leave.

Left turns join the innermost lanes, right turns the outermost, and straight connectors keep the
lane index, so that no two connectors of one carriageway cross.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from branchdrive_reference.geometry.box import wrap
from branchdrive_reference.geometry.polyline import Polyline, bezier
from branchdrive_reference.town.crossroads import Crossroads
from branchdrive_reference.town.lane import Carriageway, Lane, LaneSide, Road, Turn, carriageways
from branchdrive_reference.town.motorway import Motorway, motorway_lanes

__all__ = ["Connector", "RoadNetwork", "build_network", "connectors"]

_STRAIGHTEST_FIRST = (Turn.FOLLOW, Turn.STRAIGHT, Turn.RIGHT, Turn.LEFT)


@dataclass(frozen=True, eq=False)
class RoadNetwork:
    """A town.

    Attributes:
        name: Recorded town name.
        junctions: Every junction by name.
        lanes: Every lane by id, in declared order.
        successors: Lanes that begin where a lane ends, straightest first.
        predecessors: Lanes that end where a lane begins, straightest first.
        carriageways: Directions of every road by ``(start, end)``.
    """

    name: str
    junctions: Mapping[str, Crossroads]
    lanes: Mapping[str, Lane]
    successors: Mapping[str, tuple[Lane, ...]]
    predecessors: Mapping[str, tuple[Lane, ...]]
    carriageways: Mapping[tuple[str, str], Carriageway] = field(repr=False)

    def extended(self, chain: list[Lane], behind_m: float, ahead_m: float) -> list[Lane]:
        """The chain of lanes, lengthened over the straightest neighbours by at least the given lengths.

        Ends early where a lane has no successor or predecessor.
        """
        front, back = list(chain), []
        while ahead_m > 0 and self.successors[front[-1].lane_id]:
            front.append(self.successors[front[-1].lane_id][0])
            ahead_m -= front[-1].centre.length_m
        first = chain[0]
        while behind_m > 0 and self.predecessors[first.lane_id]:
            first = self.predecessors[first.lane_id][0]
            back.append(first)
            behind_m -= first.centre.length_m
        return back[::-1] + front

    def neighbour(self, lane: Lane, step: int) -> Lane | None:
        """The lane of the same direction `step` places further outwards, ``None`` where there is none."""
        if (lane.right if step > 0 else lane.left) is not LaneSide.SAME_DIRECTION:
            return None
        stem, _, index = lane.lane_id.rpartition(":")
        return self.lanes[f"{stem}:{int(index) + step}"]


def build_network(
    name: str, junctions: Mapping[str, Crossroads], roads: tuple[Road, ...], motorways: tuple[Motorway, ...] = ()
) -> RoadNetwork:
    """The network of declared junctions, roads and motorways."""
    ways = [way for road in roads for way in carriageways(road, junctions)]
    lanes = {lane.lane_id: lane for way in ways for lane in way.lanes}
    links: list[tuple[str, str]] = []
    for arriving in ways:
        for leaving in ways:
            if arriving.end != leaving.start:
                continue
            for lane_in, connector, lane_out in connectors(arriving, leaving, junctions[arriving.end].radius_m):
                lanes[connector.lane_id] = connector
                links += [(lane_in, connector.lane_id), (connector.lane_id, lane_out)]
    for motorway in motorways:
        built = motorway_lanes(motorway)
        lanes.update({lane.lane_id: lane for lane in built.lanes})
        links += built.links
    following: dict[str, list[Lane]] = {lane_id: [] for lane_id in lanes}
    preceding: dict[str, list[Lane]] = {lane_id: [] for lane_id in lanes}
    for lane_in, lane_out in links:
        following[lane_in].append(lanes[lane_out])
        preceding[lane_out].append(lanes[lane_in])

    def straightest_first(neighbours: dict[str, list[Lane]]) -> dict[str, tuple[Lane, ...]]:
        return {
            lane_id: tuple(sorted(found, key=lambda lane: _STRAIGHTEST_FIRST.index(lane.turn)))
            for lane_id, found in neighbours.items()
        }

    return RoadNetwork(
        name,
        junctions,
        lanes,
        straightest_first(following),
        straightest_first(preceding),
        {(way.start, way.end): way for way in ways},
    )


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
