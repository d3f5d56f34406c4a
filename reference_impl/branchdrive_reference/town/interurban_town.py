"""Reference02: a curving motorway with ramps, and winding rural roads south of it, as data.

Coordinates are metres, x east and y north.
"""

from __future__ import annotations

from functools import cache

from branchdrive_reference.town.crossroads import Control, Crossroads
from branchdrive_reference.town.lane import Road, RoadClass
from branchdrive_reference.town.motorway import Motorway
from branchdrive_reference.town.network import RoadNetwork, build_network

__all__ = ["INTERURBAN_TOWN_NAME", "interurban_town"]

INTERURBAN_TOWN_NAME = "Reference02"

_RURAL = RoadClass.RURAL

JUNCTIONS = {
    "p1": Crossroads(0.0, 0.0, Control.YIELD, frozenset({"q1", "p2"}), radius_m=20.0),
    "q1": Crossroads(560.0, -60.0, Control.STOP, frozenset({"p1", "r1"}), radius_m=20.0),
    "r1": Crossroads(1130.0, 30.0, Control.YIELD, frozenset({"q1", "s1"}), radius_m=20.0),
    "s1": Crossroads(1690.0, -20.0, Control.YIELD, frozenset({"r1", "s2"}), radius_m=20.0),
    "p2": Crossroads(-30.0, 520.0, Control.YIELD, frozenset({"p1", "q2"}), radius_m=20.0),
    "q2": Crossroads(590.0, 480.0, Control.SIGNAL, radius_m=20.0),
    "r2": Crossroads(1100.0, 560.0, Control.SIGNAL, radius_m=20.0),
    "s2": Crossroads(1720.0, 500.0, Control.YIELD, frozenset({"s1", "r2"}), radius_m=20.0),
}

ROADS = (
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

MOTORWAYS = (
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
    return build_network(INTERURBAN_TOWN_NAME, JUNCTIONS, ROADS, MOTORWAYS)
