"""Routes: where the ego drives, where a hazard may be staged, and which junction it meets.

Lengths follow the speed at which a route is cruised, so that a hazard leaves room for the history before it comes
into sight, and for the future and recovery behind it. What a route offers is its `Place`:

* `ROAD`: a stretch of road clear of junctions; the route crosses one junction before (`early`) or behind it;
* `JUNCTION`: the site is where the route enters a junction;
* `MOTORWAY`: a stretch of one motorway lane;
* `MERGE`: the site is where an entry has joined the motorway.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from types import MappingProxyType

from branchdrive_reference.geometry.polyline import Polyline, join
from branchdrive_reference.town.lane import Lane, RoadClass, Turn
from branchdrive_reference.town.motorway import TAPER_M
from branchdrive_reference.town.network import RoadNetwork

__all__ = ["CRUISE_SHARE", "OVERRUN_M", "START_M", "Place", "Route", "obstacle_sight_m", "town_routes"]

CRUISE_SHARE = 0.9
"""Cruising speed over the speed limit."""

START_M = 6.0
"""Arc length at which the ego starts."""

OVERRUN_M = 25.0
"""How far the polyline goes on beyond the goal."""

_HISTORY_S = 4.8
"""Driving time until a hazard at the site comes into sight: the history and a margin."""

_SIGHT_MIN_M, _SIGHT_S = 52.0, 4.6

_SITE_SPREAD_S = 1.5
_CLEAR_BEFORE_SITE_S = 3.4
_CLEAR_BEHIND_SITE_S = 2.4
_CLEAR_BEHIND_SITE_M = 6.0
_AFTER_SITE_S = 5.0
"""Driving times at the cruising speed of the site's lane: spread of the site, stretch around it that is
clear of the junction, and way on to the goal."""

_MOTORWAY_SPACING_M = 70.0
_MOTORWAY_MARGIN_M = (60.0, 150.0)
"""Motorway routes begin at multiples of the spacing and stay clear of the ends of the map."""

_MERGE_SHIFTS_M = (0.0, 18.0, 36.0)
"""Entries are approached from several places on their ramp."""


class Place(Enum):
    """What lies at the site of a route."""

    ROAD = "road"
    JUNCTION = "junction"
    MOTORWAY = "motorway"
    MERGE = "merge"


@dataclass(frozen=True, eq=False)
class Route:
    """A route of a town; every ``_m`` position is an arc length on `polyline`.

    Attributes:
        route_id: Identity in the town.
        town: Recorded name of the town.
        place: What lies at the site.
        chain: Lanes it follows.
        begin_m: Arc length on the first lane where the polyline begins.
        polyline: Recorded geometry, from the first vertex to the overrun's end.
        goal_m: The route is finished here.
        site_m: Interval in which a scenario stages its hazard.
        site_lane: Lane on which the hazard is staged.
        junction: The junction that it crosses; empty on a motorway.
        junction_m: Interval inside the junction, or in which an entry moves over; empty where there is neither.
        turn: Manoeuvre there.
        early: Whether the junction lies before the site.
    """

    route_id: str
    town: str
    place: Place
    chain: tuple[Lane, ...]
    begin_m: float
    polyline: Polyline
    goal_m: float
    site_m: tuple[float, float]
    site_lane: Lane
    junction: str
    junction_m: tuple[float, float]
    turn: Turn
    early: bool

    @property
    def has_clear_side_lanes(self) -> bool:
        """Whether the other lanes of the ego's direction beside the site, if any, stay clear of the route."""
        clear_road = self.place is Place.ROAD and (self.early or self.turn is Turn.STRAIGHT)
        return clear_road or self.place is Place.MOTORWAY


def obstacle_sight_m(speed_mps: float) -> float:
    """How far ahead, centre to centre, a driver at a speed looks for what stands in the way."""
    return max(_SIGHT_MIN_M, _SIGHT_S * speed_mps)


def _cut(chain: tuple[Lane, ...], begin_m: float, end_m: float) -> Polyline:
    """Centre lines of a chain between two arc lengths from the beginning of its first lane."""
    line = join([lane.centre for lane in chain])
    return line.cut(begin_m, end_m)


def _road_route(town: RoadNetwork, chain: tuple[Lane, Lane, Lane], *, early: bool) -> Route | None:
    """The early or late route of a chain, or ``None`` if a lane is too short for it."""
    first, connector, last = chain
    speed = CRUISE_SHARE * (last if early else first).speed_limit_mps
    fastest = max(speed, CRUISE_SHARE * first.speed_limit_mps)
    site_low = START_M + _HISTORY_S * fastest + obstacle_sight_m(fastest)
    site_high = site_low + _SITE_SPREAD_S * speed
    goal = site_high + _AFTER_SITE_S * speed
    if early:
        junction_end = site_low - _CLEAR_BEFORE_SITE_S * speed
        junction_begin = junction_end - connector.centre.length_m
    else:
        junction_begin = site_high + _CLEAR_BEHIND_SITE_S * speed + _CLEAR_BEHIND_SITE_M
        junction_end = junction_begin + connector.centre.length_m
    return _crossing(
        town,
        chain,
        "early" if early else "late",
        (junction_begin, junction_end),
        (site_low, site_high),
        goal,
        early=early,
    )


def _junction_route(town: RoadNetwork, chain: tuple[Lane, Lane, Lane]) -> Route | None:
    """The route of a chain whose site is the junction, or ``None`` if a lane is too short for it."""
    first, connector, last = chain
    speed = CRUISE_SHARE * first.speed_limit_mps
    site = START_M + _HISTORY_S * speed + obstacle_sight_m(speed)
    junction_end = site + connector.centre.length_m
    goal = junction_end + _AFTER_SITE_S * CRUISE_SHARE * last.speed_limit_mps
    return _crossing(town, chain, Place.JUNCTION.value, (site, junction_end), (site, site), goal, early=False)


def _crossing(
    town: RoadNetwork, chain: tuple[Lane, Lane, Lane], name: str, junction_m: tuple[float, float],
    site_m: tuple[float, float], goal_m: float, *, early: bool,
) -> Route | None:  # fmt: skip
    """The route of a chain with its junction, site and goal at arc lengths, ``None`` if a lane is too short."""
    first, connector, last = chain
    begin = first.centre.length_m - junction_m[0]
    rest = goal_m + OVERRUN_M - junction_m[1]
    if begin < 0 or junction_m[0] < START_M + 2.0 or not 0 < rest < last.centre.length_m:
        return None
    return Route(
        route_id=f"{connector.lane_id.replace(':', '.')}.{name}",
        town=town.name,
        place=Place.JUNCTION if name == Place.JUNCTION.value else Place.ROAD,
        chain=chain,
        begin_m=begin,
        polyline=_cut(chain, begin, first.centre.length_m + connector.centre.length_m + rest),
        goal_m=goal_m,
        site_m=site_m,
        site_lane=last if early else first,
        junction=connector.junction,
        junction_m=junction_m,
        turn=connector.turn,
        early=early,
    )


def _window(town: RoadNetwork, pieces: list[Lane], name: str, place: Place, begin_m: float, site: float) -> Route:
    """A route without a junction from `begin_m` on the chain of `pieces`, staged at `site` and after."""
    speed = CRUISE_SHARE * pieces[-1].speed_limit_mps
    spread = _SITE_SPREAD_S * speed if place is Place.MOTORWAY else 0.0
    goal = site + spread + _AFTER_SITE_S * speed
    end_m = begin_m + goal + OVERRUN_M
    chain: list[Lane] = []
    first_m = arc_m = 0.0
    site_lane = pieces[-1]
    for lane in pieces:
        next_m = arc_m + lane.centre.length_m
        if next_m > begin_m and arc_m < end_m:
            first_m = first_m if chain else arc_m
            chain.append(lane)
            if arc_m <= begin_m + site < next_m:
                site_lane = lane
        arc_m = next_m
    return Route(
        route_id=f"{name.replace(':', '.')}.{place.value}{round(begin_m)}",
        town=town.name,
        place=place,
        chain=tuple(chain),
        begin_m=begin_m - first_m,
        polyline=_cut(tuple(chain), begin_m - first_m, end_m - first_m),
        goal_m=goal,
        site_m=(site, site + spread),
        site_lane=site_lane,
        junction="",
        junction_m=(site - TAPER_M, site) if place is Place.MERGE else (goal, goal),
        turn=Turn.CHANGE_LEFT if place is Place.MERGE else Turn.FOLLOW,
        early=False,
    )


def _motorway_routes(town: RoadNetwork) -> Iterator[Route]:
    """Stretches of every motorway lane but the innermost, and the entries."""
    for lane in town.lanes.values():
        begins_map = not town.predecessors[lane.lane_id]
        if lane.road_class is RoadClass.RAMP and begins_map and town.successors[lane.lane_id]:
            pieces = town.extended([lane], 0.0, 1e9)
            speed = CRUISE_SHARE * lane.speed_limit_mps
            for shift in _MERGE_SHIFTS_M:
                site = START_M + _HISTORY_S * speed + 1.5 * obstacle_sight_m(speed) + shift
                yield _window(town, pieces, lane.lane_id, Place.MERGE, lane.centre.length_m - site, site)
        elif lane.road_class is RoadClass.MOTORWAY and begins_map and town.neighbour(lane, -1) is not None:
            pieces = town.extended([lane], 0.0, 1e9)
            total_m = sum(piece.centre.length_m for piece in pieces)
            speed = CRUISE_SHARE * lane.speed_limit_mps
            site = START_M + _HISTORY_S * speed + obstacle_sight_m(speed)
            length_m = site + (_SITE_SPREAD_S + _AFTER_SITE_S) * speed + OVERRUN_M
            begin_m = _MOTORWAY_MARGIN_M[0]
            while begin_m + length_m < total_m - _MOTORWAY_MARGIN_M[1]:
                yield _window(town, pieces, lane.lane_id, Place.MOTORWAY, begin_m, site)
                begin_m += _MOTORWAY_SPACING_M


def _junction_chains(town: RoadNetwork) -> Iterator[tuple[Lane, Lane, Lane]]:
    for connector in town.lanes.values():
        if connector.turn is not Turn.FOLLOW:
            yield town.predecessors[connector.lane_id][0], connector, town.successors[connector.lane_id][0]


@lru_cache(maxsize=4)
def town_routes(town: RoadNetwork) -> Mapping[str, Route]:
    """Every route of a town by id, in the order of its lanes."""
    found: list[Route | None] = []
    for chain in _junction_chains(town):
        found += [_road_route(town, chain, early=True), _road_route(town, chain, early=False)]
        found.append(_junction_route(town, chain))
    found += _motorway_routes(town)
    return MappingProxyType({route.route_id: route for route in found if route is not None})
