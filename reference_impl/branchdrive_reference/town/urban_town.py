"""Reference01: an urban grid of sixteen junctions and twenty-four roads, as data.

Residential streets have one lane each way, some with parking, and bend; three arterials have two lanes each way
and signals where they meet. Coordinates are metres, x east and y north.
"""

from __future__ import annotations

from functools import cache

from branchdrive_reference.town.crossroads import Control, Crossroads
from branchdrive_reference.town.lane import Road
from branchdrive_reference.town.network import RoadNetwork, build_network

__all__ = ["URBAN_TOWN_NAME", "urban_town"]

URBAN_TOWN_NAME = "Reference01"

_SIGNAL, _STOP, _YIELD = Control.SIGNAL, Control.STOP, Control.YIELD

JUNCTIONS = {
    "a1": Crossroads(0.0, 0.0, _YIELD, frozenset({"b1", "a2"})),
    "b1": Crossroads(246.0, -8.0, _YIELD, frozenset({"a1", "c1"})),
    "c1": Crossroads(501.0, 4.0, _STOP, frozenset({"b1", "d1"})),
    "d1": Crossroads(752.0, -3.0, _YIELD, frozenset({"c1", "d2"})),
    "a2": Crossroads(-6.0, 251.0, _SIGNAL),
    "b2": Crossroads(252.0, 243.0, _SIGNAL),
    "c2": Crossroads(495.0, 254.0, _SIGNAL),
    "d2": Crossroads(747.0, 247.0, _SIGNAL),
    "a3": Crossroads(3.0, 498.0, _STOP, frozenset({"a2", "a4"})),
    "b3": Crossroads(244.0, 503.0, _SIGNAL),
    "c3": Crossroads(506.0, 494.0, _YIELD, frozenset({"b3", "d3"})),
    "d3": Crossroads(755.0, 505.0, _YIELD, frozenset({"d2", "d4"})),
    "a4": Crossroads(-9.0, 742.0, _YIELD, frozenset({"a3", "b4"})),
    "b4": Crossroads(251.0, 757.0, _STOP, frozenset({"a4", "c4"})),
    "c4": Crossroads(498.0, 748.0, _YIELD, frozenset({"b4", "d4"})),
    "d4": Crossroads(748.0, 752.0, _YIELD, frozenset({"c4", "d3"})),
}

ROADS = (
    Road("a1", "b1", lanes=1, limit_kmh=40.0, bend_m=(14.0, 14.0)),
    Road("b1", "c1", lanes=1, limit_kmh=40.0, parking=True),
    Road("c1", "d1", lanes=1, limit_kmh=30.0, bend_m=(-12.0, 16.0)),
    Road("a2", "b2", lanes=2, limit_kmh=50.0),
    Road("b2", "c2", lanes=2, limit_kmh=50.0, bend_m=(9.0, 9.0)),
    Road("c2", "d2", lanes=2, limit_kmh=50.0, parking=True),
    Road("a3", "b3", lanes=1, limit_kmh=40.0, bend_m=(-16.0, -16.0)),
    Road("b3", "c3", lanes=1, limit_kmh=30.0, bend_m=(12.0, -12.0), parking=True),
    Road("c3", "d3", lanes=1, limit_kmh=40.0),
    Road("a4", "b4", lanes=1, limit_kmh=40.0, bend_m=(10.0, 10.0)),
    Road("b4", "c4", lanes=1, limit_kmh=50.0),
    Road("c4", "d4", lanes=1, limit_kmh=40.0, bend_m=(14.0, -10.0), parking=True),
    Road("a1", "a2", lanes=1, limit_kmh=40.0, parking=True),
    Road("a2", "a3", lanes=1, limit_kmh=30.0, bend_m=(15.0, 15.0)),
    Road("a3", "a4", lanes=1, limit_kmh=40.0),
    Road("b1", "b2", lanes=2, limit_kmh=50.0, bend_m=(-8.0, -8.0)),
    Road("b2", "b3", lanes=2, limit_kmh=50.0),
    Road("b3", "b4", lanes=2, limit_kmh=50.0, bend_m=(7.0, -7.0)),
    Road("c1", "c2", lanes=1, limit_kmh=40.0, bend_m=(13.0, -13.0)),
    Road("c2", "c3", lanes=1, limit_kmh=40.0, parking=True),
    Road("c3", "c4", lanes=1, limit_kmh=30.0),
    Road("d1", "d2", lanes=1, limit_kmh=30.0, parking=True),
    Road("d2", "d3", lanes=1, limit_kmh=40.0, bend_m=(-15.0, -15.0)),
    Road("d3", "d4", lanes=1, limit_kmh=40.0),
)


@cache
def urban_town() -> RoadNetwork:
    """The network of Reference01, built once per process."""
    return build_network(URBAN_TOWN_NAME, JUNCTIONS, ROADS)
