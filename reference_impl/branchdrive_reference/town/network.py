"""The road network: every lane of a town and how lanes follow each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from branchdrive_reference.town.crossroads import Crossroads
from branchdrive_reference.town.junction import connectors
from branchdrive_reference.town.lane import Lane, LaneSide, Turn
from branchdrive_reference.town.motorway import Motorway, motorway_lanes
from branchdrive_reference.town.road import Carriageway, Road, carriageways

__all__ = ["RoadNetwork", "build_network"]

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
