"""Every town and every route, for tests that hold for all of them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from branchdrive_reference.geometry.polyline import Array, Polyline, join
from branchdrive_reference.town.lane import Lane, RoadClass
from branchdrive_reference.town.network import RoadNetwork
from branchdrive_reference.town.route import Place, Route, town_routes
from branchdrive_reference.town.town import TOWN_NAMES, town
from branchdrive_reference.town.track import RouteTracks, route_tracks

TOWNS = tuple(town(name) for name in TOWN_NAMES)
ROUTES = tuple(route for network in TOWNS for route in town_routes(network).values())

each_town = pytest.mark.parametrize("network", TOWNS, ids=TOWN_NAMES)
each_place = pytest.mark.parametrize("place", Place, ids=lambda place: place.value)


def routes_of(place: Place) -> list[Route]:
    """Routes of all towns that offer a place."""
    return [route for route in ROUTES if route.place is place]


@cache
def tables_of(place: Place) -> tuple[RouteTracks, ...]:
    """Tables of all routes that offer a place."""
    return tuple(route_tracks(route.town, route.route_id) for route in routes_of(place))


def ramps(network: RoadNetwork, *, entries: bool) -> list[Lane]:
    """Entries or exits of a town's motorways."""
    following = network.successors if entries else network.predecessors
    return [lane for lane in network.lanes.values() if lane.road_class is RoadClass.RAMP and following[lane.lane_id]]


def motorway_beside(network: RoadNetwork, ramp: Lane, *, entry: bool) -> Polyline:
    """Centre line of the lane that an entry joins, or an exit leaves, on both sides of that place."""
    joined = (network.successors if entry else network.predecessors)[ramp.lane_id][0]
    beside = (network.predecessors if entry else network.successors)[joined.lane_id]
    other = next(lane for lane in beside if lane.road_class is RoadClass.MOTORWAY)
    first, second = (other, joined) if entry else (joined, other)
    return join([first.centre, second.centre])


def point(lane: Lane, arc_m: float, left_m: float = 0.0) -> tuple[Array, Array]:
    """World point ``[1]`` at an arc length of a lane and a distance to its left."""
    x, y = lane.centre.at(np.array([arc_m]))
    normal = np.interp(arc_m, lane.centre.arc_m, lane.centre.tangent_rad) + np.pi / 2
    return x + left_m * np.cos(normal), y + left_m * np.sin(normal)
