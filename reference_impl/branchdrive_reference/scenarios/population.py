"""Ambient population: vehicles, a cyclist, walkers and street furniture around the scenario.

Nobody of it stands in the ego's lane, and vehicles ahead start beyond the site of the hazard.
"""

from __future__ import annotations

import math

from branchdrive_reference.geometry.path import interpolate
from branchdrive_reference.noise import Purpose, choice, uniform_between
from branchdrive_reference.scenarios.stage import Stage
from branchdrive_reference.town.route import START_M
from branchdrive_reference.town.track import EGO_TRACK, NEIGHBOUR_TRACK, ONCOMING_TRACK
from branchdrive_reference.world.body import Behaviour, Body, Kind, Size

__all__ = ["CAR", "PEDESTRIAN", "VAN", "populate"]

CAR = Size(4.6, 1.9, 1.5, 1500.0)
COMPACT = Size(4.0, 1.75, 1.5, 1150.0)
VAN = Size(5.4, 2.0, 2.2, 2300.0)
CYCLE = Size(1.8, 0.6, 1.7, 90.0)
PEDESTRIAN = Size(0.5, 0.6, 1.75, 75.0)
POST = Size(0.5, 0.5, 3.0, 8000.0)
BIN = Size(1.2, 1.0, 1.3, 200.0)

_VEHICLES = (CAR, COMPACT, VAN)
_MAX_ONCOMING = 4
_WALKERS = 3
_FURNITURE = 4
_VERGE_M, _PAVEMENT_M, _PASSING_M = 1.1, 2.3, 0.9
"""Distances of furniture and of walkers from the edge of the carriageway, and of walkers that meet."""

_STRETCHES_M = ((-25.0, -4.0), (2.0, 20.0))
"""Stretches of the roadside before and behind the site."""


def _draw(stage: Stage, low: float, high: float, purpose: Purpose, index: int) -> float:
    return uniform_between(low, high, stage.seed, purpose, index)


def _vehicle(stage: Stage, index: int, arc_m: float, track: int) -> Body:
    """A vehicle with the size, desired speed and headway of draw `index`."""
    return stage.vehicle(
        _VEHICLES[choice(len(_VEHICLES), stage.seed, Purpose.TRAFFIC_BODY, index)],
        arc_m,
        track,
        eagerness=_draw(stage, 0.88, 1.05, Purpose.TRAFFIC_SPEED, index),
        headway_s=_draw(stage, 1.0, 1.6, Purpose.TRAFFIC_HEADWAY, index),
    )


def _own_lane(stage: Stage, *, ahead: bool) -> list[Body]:
    """A follower behind the ego, and a vehicle beyond the site, each present in most worlds."""
    bodies = []
    if choice(10, stage.seed, Purpose.TRAFFIC_PRESENCE, 0) < 7:
        bodies.append(_vehicle(stage, 0, START_M - _draw(stage, 20.0, 30.0, Purpose.TRAFFIC_GAP, 0), EGO_TRACK))
    if ahead and choice(10, stage.seed, Purpose.TRAFFIC_PRESENCE, 1) < 6:
        bodies.append(_vehicle(stage, 1, stage.site_m + _draw(stage, 25.0, 50.0, Purpose.TRAFFIC_GAP, 1), EGO_TRACK))
    return bodies


def _oncoming(stage: Stage) -> list[Body]:
    """A queue of oncoming vehicles, closest first; in some worlds a cyclist rides last."""
    bodies = []
    arc_m = stage.beside(START_M, ONCOMING_TRACK) - _draw(stage, 35.0, 60.0, Purpose.TRAFFIC_GAP, 10)
    count = choice(_MAX_ONCOMING + 1, stage.seed, Purpose.TRAFFIC_PRESENCE, 10)
    for index in range(11, 11 + count):
        bodies.append(_vehicle(stage, index, arc_m, ONCOMING_TRACK))
        arc_m -= _draw(stage, 25.0, 75.0, Purpose.TRAFFIC_GAP, index)
    if choice(10, stage.seed, Purpose.TRAFFIC_PRESENCE, 20) < 3:
        bodies.append(stage.vehicle(CYCLE, arc_m, ONCOMING_TRACK, kind=Kind.CYCLE, offset_m=-1.1, eagerness=0.45))
    return bodies


def _neighbour(stage: Stage) -> list[Body]:
    """Up to two vehicles in the other lane of the ego's direction, where there is one."""
    if len(stage.tables.tracks) <= NEIGHBOUR_TRACK:
        return []
    route = stage.tables.route
    begin_m = stage.beside(route.junction_m[1] if route.early else START_M, NEIGHBOUR_TRACK)
    arcs = (begin_m + offset for offset in (8.0, 45.0))
    return [
        _vehicle(stage, index, arc_m + _draw(stage, 0.0, 15.0, Purpose.TRAFFIC_GAP, index), NEIGHBOUR_TRACK)
        for index, arc_m in zip((30, 31), arcs, strict=True)
        if choice(10, stage.seed, Purpose.TRAFFIC_PRESENCE, index) < 5
    ]


def _roadside(stage: Stage, index: int, margin_m: float, purpose: Purpose) -> tuple[float, float]:
    """Arc length and offset of roadside place `index`: right and left, first before and then behind the site."""
    left_m, right_m = stage.edges_m()
    low, high = _STRETCHES_M[index // 2]
    arc_m = stage.site_m + _draw(stage, low, high, purpose, index)
    return arc_m, left_m + margin_m if index % 2 else -right_m - margin_m


def _walkers(stage: Stage) -> list[Body]:
    """Pedestrians that walk along the pavements towards the site, away from the junction."""
    bodies = []
    for index in range(_WALKERS):
        margin_m = _PAVEMENT_M + _PASSING_M * (index // 2)
        arc_m, offset_m = _roadside(stage, index, margin_m, Purpose.WALKER_PLACE)
        x, y, yaw = interpolate(stage.tables.path(EGO_TRACK), arc_m, offset_m)
        speed = _draw(stage, 0.7, 1.6, Purpose.WALKER_SPEED, index)
        heading = yaw + math.pi if arc_m > stage.site_m else yaw
        bodies.append(Body(Kind.PEDESTRIAN, Behaviour.WALKING, PEDESTRIAN, x, y, heading, speed, travel_m=25.0))
    return bodies


def _furniture(stage: Stage) -> list[Body]:
    """Posts and bins at the roadside."""
    bodies = []
    for index in range(_FURNITURE):
        arc_m, offset_m = _roadside(stage, index, _VERGE_M, Purpose.FURNITURE_PLACE)
        bodies.append(stage.standing(Kind.STATIC, (POST, BIN)[index // 2], arc_m, offset_m))
    return bodies


def populate(stage: Stage, *, ahead: bool) -> list[Body]:
    """Ambient bodies of a world; `ahead` allows a vehicle in the ego's lane beyond the site."""
    return [
        *_own_lane(stage, ahead=ahead),
        *_oncoming(stage),
        *_neighbour(stage),
        *_walkers(stage),
        *_furniture(stage),
    ]
