"""The reference town: twelve junctions and seventeen roads, as data.

Residential streets have one lane each way and bend; two arterials have two lanes each way.
Coordinates are metres, x east and y north.
"""

from __future__ import annotations

from functools import cache

from branchdrive_reference.town.network import RoadNetwork, build_network
from branchdrive_reference.town.road import Road

__all__ = ["TOWN_NAME", "reference_town"]

TOWN_NAME = "Reference01"

JUNCTIONS = {
    "a1": (0.0, 0.0), "b1": (246.0, -8.0), "c1": (501.0, 4.0), "d1": (752.0, -3.0),
    "a2": (-6.0, 251.0), "b2": (252.0, 243.0), "c2": (495.0, 254.0), "d2": (747.0, 247.0),
    "a3": (3.0, 498.0), "b3": (244.0, 503.0), "c3": (506.0, 494.0), "d3": (755.0, 505.0),
}  # fmt: skip

ROADS = (
    Road("a1", "b1", lanes=1, limit_kmh=40.0, bend_m=(14.0, 14.0)),
    Road("b1", "c1", lanes=1, limit_kmh=40.0),
    Road("c1", "d1", lanes=1, limit_kmh=30.0, bend_m=(-12.0, 16.0)),
    Road("a2", "b2", lanes=2, limit_kmh=50.0),
    Road("b2", "c2", lanes=2, limit_kmh=50.0, bend_m=(9.0, 9.0)),
    Road("c2", "d2", lanes=2, limit_kmh=50.0),
    Road("a3", "b3", lanes=1, limit_kmh=40.0, bend_m=(-16.0, -16.0)),
    Road("b3", "c3", lanes=1, limit_kmh=30.0, bend_m=(12.0, -12.0)),
    Road("c3", "d3", lanes=1, limit_kmh=40.0),
    Road("a1", "a2", lanes=1, limit_kmh=40.0),
    Road("a2", "a3", lanes=1, limit_kmh=30.0, bend_m=(15.0, 15.0)),
    Road("b1", "b2", lanes=2, limit_kmh=50.0, bend_m=(-8.0, -8.0)),
    Road("b2", "b3", lanes=2, limit_kmh=50.0),
    Road("c1", "c2", lanes=1, limit_kmh=40.0, bend_m=(13.0, -13.0)),
    Road("c2", "c3", lanes=1, limit_kmh=40.0),
    Road("d1", "d2", lanes=1, limit_kmh=30.0),
    Road("d2", "d3", lanes=1, limit_kmh=40.0, bend_m=(-15.0, -15.0)),
)


@cache
def reference_town() -> RoadNetwork:
    """The network of the reference town, built once per process."""
    return build_network(TOWN_NAME, JUNCTIONS, ROADS)
