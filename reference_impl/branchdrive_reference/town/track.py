"""Tracks: the paths that the ego and the traffic of one route follow, as one vertex table.

Track 0 is the ego's route, lengthened at both ends; its arc lengths are those of the route's
polyline, negative behind its beginning. Track 1 is the oncoming way. Track 2, where the road of the
site has a second lane in the ego's direction whose traffic cannot meet the route again, is that
lane. By construction (`town.junction`) the three never cross.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from branchdrive_reference.geometry.path import VERTEX
from branchdrive_reference.geometry.polyline import Array, Polyline, join
from branchdrive_reference.town.lane import Lane, LaneSide, Turn
from branchdrive_reference.town.network import RoadNetwork
from branchdrive_reference.town.reference_town import reference_town
from branchdrive_reference.town.route import CRUISE_SHARE, Route, town_routes

__all__ = ["EGO_TRACK", "NEIGHBOUR_TRACK", "ONCOMING_TRACK", "TRACK", "RouteTracks", "route_tracks"]

TRACK = np.dtype([("first", np.int64), ("end", np.int64)], align=True)
"""Vertex range of a track."""

EGO_TRACK, ONCOMING_TRACK, NEIGHBOUR_TRACK = 0, 1, 2

_BEHIND_M, _AHEAD_M = 80.0, 200.0
"""How far tracks go on beyond the lanes of the route."""

_CURVE_ACCEL_MPS2 = 2.5
_CURVE_BRAKE_MPS2 = 1.5
"""Lateral acceleration in a curve and deceleration before it, for the advisory speed."""


@dataclass(frozen=True, eq=False)
class RouteTracks:
    """Tables of one route, shared by all its worlds and never written to.

    Attributes:
        route: The route.
        vertices: `VERTEX` ``[vertices]`` of all tracks, one after the other.
        tracks: `TRACK` ``[tracks]``.
        limit_mps: Speed limit by track-0 vertex ``[track-0 vertices]``.
    """

    route: Route
    vertices: NDArray[np.void]
    tracks: NDArray[np.void]
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
    for index in range(len(arc) - 2, -1, -1):
        square[index] = min(square[index], square[index + 1] + 2 * _CURVE_BRAKE_MPS2 * (arc[index + 1] - arc[index]))
    return np.sqrt(square)


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


def _oncoming_chain(town: RoadNetwork, route: Route) -> list[Lane]:
    """The route's roads driven the other way; a left turn seen from there is a right turn."""
    first, _, last = route.chain
    arriving, leaving = town.carriageways[last.way[::-1]], town.carriageways[first.way[::-1]]
    for lane in arriving.lanes:
        for connector in town.successors[lane.lane_id]:
            following = town.successors[connector.lane_id][0]
            if following in leaving.lanes:
                return [lane, connector, following]
    raise LookupError(f"route {route.route_id!r} cannot be driven the other way")


def _neighbour_chain(town: RoadNetwork, route: Route) -> list[Lane] | None:
    """The other lane in the ego's direction beside the site, if its way stays clear of the route."""
    if not (route.early or route.turn is Turn.STRAIGHT):
        return None
    lane = route.site_lane
    if LaneSide.SAME_DIRECTION not in (lane.left, lane.right):
        return None
    return [next(other for other in town.carriageways[lane.way].lanes if other is not lane)]


@lru_cache(maxsize=256)
def route_tracks(route_id: str) -> RouteTracks:
    """Tables of a route of the reference town, built once per process."""
    town = reference_town()
    route = town_routes(town)[route_id]
    chains = [(list(route.chain), route.begin_m), (_oncoming_chain(town, route), 0.0)]
    neighbour = _neighbour_chain(town, route)
    if neighbour is not None:
        chains.append((neighbour, 0.0))
    tables: list[NDArray[np.void]] = []
    limits: list[Array] = []
    for chain, begin_m in chains:
        extended = town.extended(chain, _BEHIND_M, _AHEAD_M)
        before_m = sum(lane.centre.length_m for lane in extended[: extended.index(chain[0])])
        table, limit = _vertices(extended, before_m + begin_m)
        tables.append(table)
        limits.append(limit)
    ends = np.cumsum([len(table) for table in tables])
    tracks = np.zeros(len(tables), TRACK)
    tracks["first"], tracks["end"] = np.concatenate([[0], ends[:-1]]), ends
    return RouteTracks(route, np.concatenate(tables), tracks, limits[0])
