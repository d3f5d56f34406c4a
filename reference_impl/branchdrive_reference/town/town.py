"""The towns, as data: each declared by its junctions and roads, and built by its recorded name.

Reference01 is an urban grid of sixteen junctions and twenty-four roads. Residential streets have one lane each way,
some with parking, and bend; three arterials have two lanes each way and signals where they meet. Reference02 is a
curving motorway with ramps, and winding rural roads south of it. Coordinates are metres, x east and y north.
"""

from __future__ import annotations

from functools import cache
from types import MappingProxyType

from branchdrive_reference.town.crossroads import Control, Crossroads
from branchdrive_reference.town.lane import Road, RoadClass
from branchdrive_reference.town.motorway import Motorway
from branchdrive_reference.town.network import RoadNetwork, build_network

__all__ = ["INTERURBAN_TOWN_NAME", "TOWN_NAMES", "URBAN_TOWN_NAME", "interurban_town", "town", "urban_town"]

URBAN_TOWN_NAME = "Reference01"
INTERURBAN_TOWN_NAME = "Reference02"

_SIGNAL, _STOP, _YIELD = Control.SIGNAL, Control.STOP, Control.YIELD
_RURAL = RoadClass.RURAL

URBAN_JUNCTIONS = {
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

URBAN_ROADS = (
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
    return build_network(URBAN_TOWN_NAME, URBAN_JUNCTIONS, URBAN_ROADS)


INTERURBAN_JUNCTIONS = {
    "p1": Crossroads(0.0, 0.0, Control.YIELD, frozenset({"q1", "p2"}), radius_m=20.0),
    "q1": Crossroads(560.0, -60.0, Control.STOP, frozenset({"p1", "r1"}), radius_m=20.0),
    "r1": Crossroads(1130.0, 30.0, Control.YIELD, frozenset({"q1", "s1"}), radius_m=20.0),
    "s1": Crossroads(1690.0, -20.0, Control.YIELD, frozenset({"r1", "s2"}), radius_m=20.0),
    "p2": Crossroads(-30.0, 520.0, Control.YIELD, frozenset({"p1", "q2"}), radius_m=20.0),
    "q2": Crossroads(590.0, 480.0, Control.SIGNAL, radius_m=20.0),
    "r2": Crossroads(1100.0, 560.0, Control.SIGNAL, radius_m=20.0),
    "s2": Crossroads(1720.0, 500.0, Control.YIELD, frozenset({"s1", "r2"}), radius_m=20.0),
}

INTERURBAN_ROADS = (
    Road("p1", "q1", lanes=1, limit_kmh=60.0, bend_m=(45.0, 45.0), road_class=_RURAL),
    Road("q1", "r1", lanes=1, limit_kmh=60.0, bend_m=(-35.0, 30.0), road_class=_RURAL),
    Road("r1", "s1", lanes=1, limit_kmh=60.0, road_class=_RURAL),
    Road("p2", "q2", lanes=1, limit_kmh=60.0, bend_m=(-40.0, 50.0), road_class=_RURAL),
    Road("q2", "r2", lanes=1, limit_kmh=60.0, road_class=_RURAL),
    Road("r2", "s2", lanes=1, limit_kmh=60.0, bend_m=(35.0, 35.0), road_class=_RURAL),
    Road("p1", "p2", lanes=1, limit_kmh=50.0, bend_m=(30.0, 30.0), road_class=_RURAL),
    Road("q1", "q2", lanes=1, limit_kmh=60.0, bend_m=(-40.0, 25.0), road_class=_RURAL),
    Road("r1", "r2", lanes=1, limit_kmh=60.0, road_class=_RURAL),
    Road("s1", "s2", lanes=1, limit_kmh=50.0, bend_m=(-30.0, -30.0), road_class=_RURAL),
)

INTERURBAN_MOTORWAYS = (
    Motorway(
        "m",
        axis_m=(
            (-1150.0, 1040.0), (-500.0, 1000.0), (100.0, 1060.0), (700.0, 950.0), (1300.0, 1010.0), (1850.0, 930.0),
            (2450.0, 1080.0), (3000.0, 1030.0),
        ),
        lanes=3,
        limit_kmh=100.0,
        ramp_limit_kmh=80.0,
        entries_m=(500.0, 1450.0, 2400.0, 3350.0),
        exits_m=(650.0, 1600.0, 2550.0),
        back_entries_m=(470.0, 1430.0, 2390.0, 3350.0),
        back_exits_m=(630.0, 1590.0, 2550.0),
    ),
)  # fmt: skip


@cache
def interurban_town() -> RoadNetwork:
    """The network of Reference02, built once per process."""
    return build_network(INTERURBAN_TOWN_NAME, INTERURBAN_JUNCTIONS, INTERURBAN_ROADS, INTERURBAN_MOTORWAYS)


_BUILDERS = MappingProxyType({URBAN_TOWN_NAME: urban_town, INTERURBAN_TOWN_NAME: interurban_town})

TOWN_NAMES = tuple(_BUILDERS)
"""Names of the towns, in a fixed order."""


def town(name: str) -> RoadNetwork:
    """The network of a town, built once per process.

    Raises:
        KeyError: There is no town of this name.
    """
    return _BUILDERS[name]()
