"""Tracks: the paths that the ego and the traffic of one route follow, as one vertex table.

Track 0 is the ego's route, lengthened at both ends; its arc lengths are those of the route's polyline, negative
behind its beginning. Which other tracks there are depends on the route's place; `Role` names them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from branchdrive_reference.geometry.box import wrap
from branchdrive_reference.geometry.polyline import VERTEX, Array, Polyline, join
from branchdrive_reference.town.conflict import OPPOSITE_RAD, TrackCourse, conflict_table
from branchdrive_reference.town.crossroads import Control
from branchdrive_reference.town.lane import Lane, RoadClass, Turn
from branchdrive_reference.town.network import RoadNetwork
from branchdrive_reference.town.route import CRUISE_SHARE, Place, Route, town_routes
from branchdrive_reference.town.signal import NO_GROUP, approach_group
from branchdrive_reference.town.town import town

__all__ = ["EGO_TRACK", "TRACK", "Role", "RouteTracks", "route_tracks"]

TRACK = np.dtype(
    [
        ("first", np.int64),  # vertex range
        ("end", np.int64),
        ("stop_m", np.float64),  # arc length of the line before the junction; infinite where there is none
        ("group", np.int64),  # signal group there, `NO_GROUP` without signals
        ("stop_sign", np.int64),  # whether there is a stop sign
    ],
    align=True,
)
"""One track."""

EGO_TRACK = 0

_BEHIND_M, _AHEAD_M = 80.0, 200.0
"""How far tracks go on beyond the lanes of the route."""

_LINE_BEFORE_JUNCTION_M = 1.0

_CURVE_ACCEL_MPS2 = 2.5
_CURVE_BRAKE_MPS2 = 1.5
"""Lateral acceleration in a curve and deceleration before it, for the advisory speed."""


class Role(IntEnum):
    """What a track is to the ego."""

    EGO = 0
    ONCOMING = 1  # the route's roads, driven the other way
    LEFT_LANE = 2  # of the ego's direction, beside the site
    RIGHT_LANE = 3
    OPPOSITE = 4  # through the junction, from the other side
    FROM_LEFT = 5
    FROM_RIGHT = 6
    MAINLINE = 7  # the motorway lane that an entry joins


@dataclass(frozen=True, eq=False)
class RouteTracks:
    """Tables of one route, shared by all its worlds and never written to.

    Attributes:
        route: The route.
        vertices: `VERTEX` ``[vertices]`` of all tracks, one after the other.
        tracks: `TRACK` ``[tracks]``.
        roles: Row of the track that plays a role, for the roles that there are.
        conflicts: `CONFLICT` rows: who yields to whom where.
        limit_mps: Speed limit by track-0 vertex ``[track-0 vertices]``.
    """

    route: Route
    vertices: NDArray[np.void]
    tracks: NDArray[np.void]
    roles: Mapping[Role, int]
    conflicts: NDArray[np.void]
    limit_mps: Array

    def path(self, track: int) -> NDArray[np.void]:
        """Vertices of one track."""
        return self.vertices[self.tracks[track]["first"] : self.tracks[track]["end"]]


def _advisory_speed_mps(line: Polyline, limit_mps: Array) -> Array:
    """Highest speed from which every limit and curve ahead is met with comfortable braking.

    ``v^2 <= a_lat / |curvature|`` at every vertex, then ``v_i^2 <= v_{i+1}^2 + 2 b ds`` backwards.
    """
    arc, tangent = line.arc_m, line.tangent_rad
    curvature = np.abs(np.gradient(tangent, arc))
    square = np.minimum((CRUISE_SHARE * limit_mps) ** 2, _CURVE_ACCEL_MPS2 / np.maximum(curvature, 1e-6))
    # v_i^2 - 2 b (L - s_i) <= min over j >= i of v_j^2 - 2 b (L - s_j), so a running minimum from the end will do
    brake = 2 * _CURVE_BRAKE_MPS2 * (arc[-1] - arc)
    reachable: Array = np.minimum.accumulate((square - brake)[::-1])[::-1] + brake
    return np.sqrt(reachable)


def _per_vertex(chain: list[Lane], values: list[float]) -> Array:
    """One value per vertex of the joined chain; the shared vertex belongs to the earlier lane."""
    counts = [len(lane.centre.x_m) - (index > 0) for index, lane in enumerate(chain)]
    return np.repeat(np.asarray(values, np.float64), counts)


def _vertices(chain: list[Lane], arc_zero_m: float) -> tuple[NDArray[np.void], Array]:
    """Vertex table and speed limits of a chain whose arc length `arc_zero_m` counts as 0."""
    line = join([lane.centre for lane in chain])
    limit = _per_vertex(chain, [lane.speed_limit_mps for lane in chain])
    table = np.zeros(len(line.x_m), VERTEX)
    table["x_m"], table["y_m"] = line.x_m, line.y_m
    table["arc_m"] = line.arc_m - arc_zero_m
    table["tangent_rad"] = line.tangent_rad
    table["advisory_speed_mps"] = _advisory_speed_mps(line, limit)
    table["left_lane"] = _per_vertex(chain, [lane.left for lane in chain])
    table["right_lane"] = _per_vertex(chain, [lane.right for lane in chain])
    return table, limit


def _through(network: RoadNetwork, approach: tuple[str, str], leaving: str | None = None, *, outer: bool) -> list[Lane]:
    """Road lane, connector, road lane from an approach to a neighbour, by default the straightest way."""
    for lane in network.carriageways[approach].lanes[:: -1 if outer else 1]:
        for connector in network.successors[lane.lane_id]:
            if leaving is None or connector.way[1] == leaving:
                return [lane, connector, network.successors[connector.lane_id][0]]
    raise LookupError(f"no way from {approach} to {leaving}")


def _approaches(network: RoadNetwork, route: Route) -> dict[Role, tuple[str, str]]:
    """The other approaches of a route's junction, by the side from which they come."""
    own = network.carriageways[route.chain[0].way].lanes[0].centre.tangent_rad[-1]
    found: dict[Role, tuple[str, str]] = {}
    for way, carriageway in network.carriageways.items():
        if way[1] != route.junction or way == route.chain[0].way:
            continue
        side = wrap(float(carriageway.lanes[0].centre.tangent_rad[-1] - own))
        if abs(side) > OPPOSITE_RAD:
            found[Role.OPPOSITE] = way
        else:
            found[Role.FROM_LEFT if side < 0 else Role.FROM_RIGHT] = way
    return found


def _side_lanes(network: RoadNetwork, route: Route) -> dict[Role, list[Lane]]:
    """Lanes of the ego's direction beside the site, if their way stays clear of the route."""
    if not route.has_clear_side_lanes:
        return {}
    sides = {Role.LEFT_LANE: -1, Role.RIGHT_LANE: 1}
    first = route.chain[0] if route.place is Place.MOTORWAY else route.site_lane
    found = {role: network.neighbour(first, step) for role, step in sides.items()}
    return {role: [lane] for role, lane in found.items() if lane is not None}


def _chains(network: RoadNetwork, route: Route) -> dict[Role, list[Lane]]:
    """Lanes of every track of a route, before they are lengthened."""
    chains: dict[Role, list[Lane]] = {Role.EGO: list(route.chain)}
    match route.place:
        case Place.ROAD:
            back = (route.chain[-1].way[::-1], route.chain[0].way[0])
            chains[Role.ONCOMING] = _through(network, back[0], back[1], outer=route.turn is Turn.LEFT)
        case Place.JUNCTION:
            for role, approach in _approaches(network, route).items():
                chains[role] = _through(network, approach, outer=route.turn is Turn.RIGHT)
        case Place.MERGE:
            joined = next(lane for lane in route.chain if lane.road_class is RoadClass.MOTORWAY)
            before = next(
                lane for lane in network.predecessors[joined.lane_id] if lane.road_class is RoadClass.MOTORWAY
            )
            chains[Role.MAINLINE] = [before, *route.chain[route.chain.index(joined) :]]
            left = network.neighbour(before, -1)
            if left is not None:
                chains[Role.LEFT_LANE] = [left]
        case Place.MOTORWAY:
            pass
    return chains | _side_lanes(network, route)


def _course(network: RoadNetwork, route: Route, extended: list[Lane], arc_zero_m: float) -> TrackCourse:
    """Where a track crosses the junction of the route, and under which rule."""
    crossing = (lane for lane in extended if lane.turn is not Turn.FOLLOW and lane.junction == route.junction)
    connector = next(crossing, None)
    if connector is None:
        return TrackCourse(np.inf, np.inf, NO_GROUP, stops=False, turn=Turn.FOLLOW)
    begin_m = sum(lane.centre.length_m for lane in extended[: extended.index(connector)]) - arc_zero_m
    approach = extended[extended.index(connector) - 1]
    crossroads = network.junctions[connector.junction]
    signal = crossroads.control is Control.SIGNAL
    minor = not signal and approach.way[0] not in crossroads.major
    return TrackCourse(
        begin_m,
        begin_m + connector.centre.length_m,
        approach_group(float(approach.centre.tangent_rad[-1])) if signal else NO_GROUP,
        stops=minor and crossroads.control is Control.STOP,
        turn=connector.turn,
        major=signal or not minor,
    )


@lru_cache(maxsize=256)
def route_tracks(town_name: str, route_id: str) -> RouteTracks:
    """Tables of a route, built once per process.

    Raises:
        KeyError: There is no such town or route.
    """
    network = town(town_name)
    route = town_routes(network)[route_id]
    tables: list[NDArray[np.void]] = []
    courses: list[TrackCourse] = []
    limits: list[Array] = []
    roles: dict[Role, int] = {}
    for role, chain in _chains(network, route).items():
        extended = network.extended(chain, _BEHIND_M, _AHEAD_M)
        before_m = sum(lane.centre.length_m for lane in extended[: extended.index(chain[0])])
        arc_zero_m = before_m + (route.begin_m if role is Role.EGO else 0.0)
        table, limit = _vertices(extended, arc_zero_m)
        roles[role] = len(tables)
        tables.append(table)
        limits.append(limit)
        courses.append(_course(network, route, extended, arc_zero_m))
    ends = np.cumsum([len(table) for table in tables])
    tracks = np.zeros(len(tables), TRACK)
    tracks["first"], tracks["end"] = np.concatenate([[0], ends[:-1]]), ends
    tracks["stop_m"] = [course.begin_m - _LINE_BEFORE_JUNCTION_M for course in courses]
    tracks["group"] = [course.group for course in courses]
    tracks["stop_sign"] = [course.stops for course in courses]
    merge = roles.get(Role.MAINLINE)
    conflicts = conflict_table(tables, courses, merging=(EGO_TRACK, merge) if merge is not None else None)
    return RouteTracks(route, np.concatenate(tables), tracks, roles, conflicts, limits[0])
