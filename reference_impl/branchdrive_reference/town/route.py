"""Routes: where the ego drives, where a hazard may be staged, and which traffic can be met.

A route crosses one junction. Its lengths follow the speed at which it is cruised, so that a hazard
leaves room for the history before it comes into sight, and for the future and recovery behind it.

In an `early` route the junction lies before the site, in a `late` route behind it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

from branchdrive_reference.geometry.polyline import Polyline, join
from branchdrive_reference.town.lane import Lane, Turn
from branchdrive_reference.town.network import RoadNetwork

__all__ = ["CRUISE_SHARE", "OVERRUN_M", "START_M", "Route", "town_routes"]

CRUISE_SHARE = 0.9
"""Cruising speed over the speed limit."""

START_M = 6.0
"""Arc length at which the ego starts."""

OVERRUN_M = 25.0
"""How far the polyline goes on beyond the goal."""

_HISTORY_S, _SIGHT_M = 4.8, 52.0
"""Driving time until a hazard at the site comes into sight (the history and a margin), and the way from there."""

_SITE_SPREAD_S = 1.5
_CLEAR_BEFORE_SITE_S = 3.4
_CLEAR_BEHIND_SITE_S = 2.4
_CLEAR_BEHIND_SITE_M = 6.0
_AFTER_SITE_S = 5.0
"""Driving times at the cruising speed of the site's lane: spread of the site, stretch around it that is
clear of the junction, and way on to the goal."""


@dataclass(frozen=True, eq=False)
class Route:
    """A route of the town; every ``_m`` position is an arc length on `polyline`.

    Attributes:
        route_id: Identity in the town.
        chain: Lanes it follows: road lane, connector, road lane.
        begin_m: Arc length on the first lane where the polyline begins.
        polyline: Recorded geometry, from the first vertex to the overrun's end.
        goal_m: The route is finished here.
        site_m: Interval in which a scenario stages its hazard.
        junction_m: Interval inside the junction.
        turn: Manoeuvre at the junction.
        early: Whether the junction lies before the site.
    """

    route_id: str
    chain: tuple[Lane, Lane, Lane]
    begin_m: float
    polyline: Polyline
    goal_m: float
    site_m: tuple[float, float]
    junction_m: tuple[float, float]
    turn: Turn
    early: bool

    @property
    def site_lane(self) -> Lane:
        """Lane on which the hazard is staged."""
        return self.chain[2] if self.early else self.chain[0]


def _route(chain: tuple[Lane, Lane, Lane], *, early: bool) -> Route | None:
    """The early or late route of a chain, or ``None`` if a lane is too short for it."""
    first, connector, last = chain
    speed = CRUISE_SHARE * (last if early else first).speed_limit_mps
    fastest = max(speed, CRUISE_SHARE * first.speed_limit_mps)
    site_low = START_M + _HISTORY_S * fastest + _SIGHT_M
    site_high = site_low + _SITE_SPREAD_S * speed
    goal = site_high + _AFTER_SITE_S * speed
    if early:
        junction_end = site_low - _CLEAR_BEFORE_SITE_S * speed
        junction_begin = junction_end - connector.centre.length_m
    else:
        junction_begin = site_high + _CLEAR_BEHIND_SITE_S * speed + _CLEAR_BEHIND_SITE_M
        junction_end = junction_begin + connector.centre.length_m
    begin = first.centre.length_m - junction_begin
    rest = goal + OVERRUN_M - junction_end
    if begin < 0 or junction_begin < START_M + 2.0 or not 0 < rest < last.centre.length_m:
        return None
    polyline = join([first.centre.cut(begin, first.centre.length_m), connector.centre, last.centre.cut(0.0, rest)])
    return Route(
        route_id=f"{connector.lane_id.replace(':', '.')}.{'early' if early else 'late'}",
        chain=chain,
        begin_m=begin,
        polyline=polyline,
        goal_m=goal,
        site_m=(site_low, site_high),
        junction_m=(junction_begin, junction_end),
        turn=connector.turn,
        early=early,
    )


@lru_cache(maxsize=4)
def town_routes(town: RoadNetwork) -> Mapping[str, Route]:
    """Every route of a town by id, in the order of its connectors."""
    routes: dict[str, Route] = {}
    for connector in town.lanes.values():
        if connector.turn is Turn.FOLLOW:
            continue
        first = town.predecessors[connector.lane_id][0]
        last = town.successors[connector.lane_id][0]
        for early in (True, False):
            route = _route((first, connector, last), early=early)
            if route is not None:
                routes[route.route_id] = route
    return MappingProxyType(routes)
