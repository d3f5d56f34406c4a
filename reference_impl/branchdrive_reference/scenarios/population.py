"""Ambient population: vehicles, a cyclist, walkers and street furniture around the scenario.

Nobody of it stands in the ego's lane, and vehicles ahead start beyond the site of the hazard. Every group of
bodies draws by indices of its own, so that leaving one out moves no other at the start.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from branchdrive_reference.geometry.polyline import interpolate
from branchdrive_reference.noise import Purpose, choice
from branchdrive_reference.scenarios.scenario import Ambient
from branchdrive_reference.scenarios.stage import Stage
from branchdrive_reference.town.lane import LANE_WIDTH_M, PARKING_WIDTH_M, LaneSide
from branchdrive_reference.town.route import START_M, Place
from branchdrive_reference.town.track import EGO_TRACK, Role
from branchdrive_reference.world.body import BICYCLE, BIN, PEDESTRIAN, POST, VEHICLES, Behaviour, Body, Kind

__all__ = ["PARKED_OFFSET_M", "ambient_vehicle", "populate"]

PARKED_OFFSET_M = -(LANE_WIDTH_M + PARKING_WIDTH_M) / 2
"""Where parked vehicles stand, from the middle of the lane beside the strip."""

_MAX_ONCOMING = 4
_CYCLIST_BEHIND_M = 70.0
"""How far a cyclist rides behind the oncoming queue: who waits for a slow one to pass would wait too long."""

_WALKERS = 6
_FURNITURE = 4
_WAITING_TENTHS = 4
_WAITING_M = (2.0, 4.0)
_CORNER_M = 3.0
_KEPT_M = 0.7
"""Distance that walkers keep to what stands in their way."""

_MOST_WALKED_M = 25.0
_VERGE_M, _PAVEMENT_M, _PASSING_M = 1.1, 2.8, 0.9
"""Distances of furniture and of walkers from the edge of the paved road, and of walkers that meet."""

_STRETCHES_M = ((-25.0, -8.0), (2.0, 20.0), (-45.0, -15.0))
"""Stretches of the roadside before and behind the site, and further before it; they leave room at the site."""

_BESIDE_ON_ROADS_M: tuple[float, ...] = (8.0, 45.0)
_BESIDE_ON_MOTORWAYS_M: tuple[float, ...] = (-45.0, -22.0, 0.0, 22.0, 48.0)
_BESIDE_ON_ROADS_TENTHS, _BESIDE_ON_MOTORWAYS_TENTHS = 5, 7
"""Where vehicles in other lanes begin, and in how many worlds of ten each is there."""

_PARKED_AT_M = (-34.0, -24.0, -13.0, 12.0, 22.0, 33.0)
_PARKED_TENTHS = 6


def _present(stage: Stage, index: int, tenths: int) -> bool:
    return choice(10, stage.seed, Purpose.TRAFFIC_PRESENCE, index) < tenths


def ambient_vehicle(stage: Stage, index: int, arc_m: float, track: int) -> Body:
    """A vehicle with the size, desired speed and headway of draw `index`."""
    return stage.vehicle(
        stage.pick(VEHICLES, Purpose.TRAFFIC_BODY, index),
        arc_m,
        track,
        eagerness=stage.draw(0.88, 1.05, Purpose.TRAFFIC_SPEED, index),
        headway_s=stage.draw(1.0, 1.6, Purpose.TRAFFIC_HEADWAY, index),
    )


def _own_lane(stage: Stage, ambient: Ambient) -> list[Body]:
    """A follower behind the ego, and a vehicle beyond the site, each present in most worlds."""
    bodies, headway_m = [], 1.6 * stage.advisory_mps(START_M)
    if ambient.behind and _present(stage, 0, 8):
        gap_m = headway_m + stage.draw(0.0, 10.0, Purpose.TRAFFIC_GAP, 0)
        bodies.append(ambient_vehicle(stage, 0, START_M - gap_m, EGO_TRACK))
    if ambient.ahead and _present(stage, 1, 6):
        gap_m = stage.draw(25.0, 50.0, Purpose.TRAFFIC_GAP, 1)
        bodies.append(ambient_vehicle(stage, 1, stage.site_m + gap_m, EGO_TRACK))
    return bodies


def _oncoming(stage: Stage) -> list[Body]:
    """A queue of oncoming vehicles, closest first; in some worlds a cyclist rides last."""
    track = stage.track(Role.ONCOMING)
    if track is None:
        return []
    bodies = []
    arc_m = stage.beside(START_M, track) - stage.draw(35.0, 60.0, Purpose.TRAFFIC_GAP, 10)
    for index in range(11, 11 + choice(_MAX_ONCOMING + 1, stage.seed, Purpose.TRAFFIC_PRESENCE, 10)):
        bodies.append(ambient_vehicle(stage, index, arc_m, track))
        arc_m -= stage.draw(25.0, 75.0, Purpose.TRAFFIC_GAP, index)
    if _present(stage, 20, 3):
        last_m = arc_m - _CYCLIST_BEHIND_M
        bodies.append(stage.vehicle(BICYCLE, last_m, track, kind=Kind.CYCLE, offset_m=-1.1, eagerness=0.45))
    return bodies


def _beside(stage: Stage) -> list[Body]:
    """Vehicles in the other lanes of the ego's direction, where there are any."""
    route = stage.tables.route
    bodies = []
    for side, role in enumerate((Role.LEFT_LANE, Role.RIGHT_LANE)):
        track = stage.track(role)
        if track is None:
            continue
        if route.place is Place.ROAD:
            begin_m = stage.beside(route.junction_m[1] if route.early else START_M, track)
            gaps_m, tenths = _BESIDE_ON_ROADS_M, _BESIDE_ON_ROADS_TENTHS
        else:
            begin_m = stage.beside(START_M, track)
            gaps_m, tenths = _BESIDE_ON_MOTORWAYS_M, _BESIDE_ON_MOTORWAYS_TENTHS
        for place, gap_m in enumerate(gaps_m):
            index = 30 + 5 * side + place
            if _present(stage, index, tenths):
                arc_m = begin_m + gap_m + stage.draw(0.0, 15.0, Purpose.TRAFFIC_GAP, index)
                bodies.append(ambient_vehicle(stage, index, arc_m, track))
    return bodies


def _mainline(stage: Stage) -> list[Body]:
    """Vehicles on the lane that an entry joins, spread around the ego's arrival."""
    track = stage.track(Role.MAINLINE)
    if track is None:
        return []
    _, join_m = stage.meeting_m(track)
    lead_s = stage.ego_arrival_s(stage.site_m)
    times_s = (-7.0, -3.5, 0.0, 3.5, 7.0)
    return [
        ambient_vehicle(stage, index, stage.arc_before(track, join_m, lead_s + time_s + jitter_s), track)
        for index, time_s in enumerate(times_s, 40)
        if _present(stage, index, 6)
        for jitter_s in [stage.draw(-0.8, 0.8, Purpose.TRAFFIC_GAP, index)]
    ]


def _crossing(stage: Stage) -> list[Body]:
    """Up to two vehicles from each other side of the junction, at any time."""
    bodies = []
    for side, role in enumerate((Role.OPPOSITE, Role.FROM_LEFT, Role.FROM_RIGHT)):
        track = stage.track(role)
        if track is None:
            continue
        line_m = float(stage.tables.tracks[track]["stop_m"])
        for place, (low_m, high_m) in enumerate(((20.0, 70.0), (90.0, 140.0))):
            index = 50 + 2 * side + place
            if _present(stage, index, 5):
                arc_m = line_m - stage.draw(low_m, high_m, Purpose.TRAFFIC_GAP, index)
                bodies.append(ambient_vehicle(stage, index, arc_m, track))
    return bodies


def _parked(stage: Stage) -> list[Body]:
    """Parked vehicles on the strip beside the site; a gap around the site is left for scenarios."""
    if stage.tables.route.site_lane.right is not LaneSide.PARKING or stage.tables.route.place is not Place.ROAD:
        return []
    bodies = []
    for place, ahead_m in enumerate(_PARKED_AT_M):
        index = 70 + place
        if choice(10, stage.seed, Purpose.PARKED_PRESENCE, index) < _PARKED_TENTHS:
            size = stage.pick(VEHICLES, Purpose.TRAFFIC_BODY, index)
            arc_m = stage.site_m + ahead_m + stage.draw(-1.5, 1.5, Purpose.PARKED_PLACE, index)
            if _clear_m(stage, arc_m) > size.length_m / 2:
                bodies.append(stage.standing(Kind.VEHICLE, size, arc_m, PARKED_OFFSET_M))
    return bodies


def _roadside(stage: Stage, index: int, margin_m: float, purpose: Purpose) -> tuple[float, float]:
    """Arc length and offset of roadside place `index`: right and left, first before and then behind the site."""
    left_m, right_m = stage.edges_m()
    low, high = _STRETCHES_M[index // 2]
    arc_m = stage.site_m + stage.draw(low, high, purpose, index)
    return arc_m, left_m + margin_m if index % 2 else -right_m - margin_m


def _walkers(stage: Stage) -> list[Body]:
    """Pedestrians that walk along the pavements of the road up to its junction; before it only if it is the site."""
    bodies = []
    places = (0, 1, 4, 5) if stage.tables.route.place is Place.JUNCTION else range(_WALKERS)
    for index in places:
        margin_m = _PAVEMENT_M + _PASSING_M * (index // 2)
        arc_m, offset_m = _roadside(stage, index, margin_m, Purpose.WALKER_PLACE)
        x, y, yaw = interpolate(stage.tables.path(EGO_TRACK), arc_m, offset_m)
        speed = stage.draw(0.7, 1.6, Purpose.WALKER_SPEED, index)
        heading = yaw + math.pi if choice(2, stage.seed, Purpose.WALKER_HEADING, index) else yaw
        clear_m = _clear_m(stage, arc_m)
        if clear_m > 0.0:
            towards_junction = (heading == yaw) == (arc_m < stage.tables.route.junction_m[0])
            travel_m = min(_MOST_WALKED_M, clear_m if towards_junction else math.inf)
            bodies.append(Body(Kind.PEDESTRIAN, Behaviour.WALKING, PEDESTRIAN, x, y, heading, speed, travel_m=travel_m))
    return bodies


def _clear_m(stage: Stage, arc_m: float) -> float:
    """Distance of a place on the roadside to the corners of the junction; negative inside."""
    begin_m, end_m = stage.tables.route.junction_m
    return max(begin_m - arc_m, arc_m - end_m) - _CORNER_M


def _waiting(stage: Stage) -> list[Body]:
    """Pedestrians who stand at the corners of the junction, on the ego's side of its mouths."""
    begin_m, end_m = stage.tables.route.junction_m
    bodies = []
    first, last = stage.tables.route.chain[0], stage.tables.route.chain[-1]
    for index, (arc_m, lane) in enumerate(((begin_m - 2.0, first), (end_m + 2.0, last))):
        for side, edge_m in ((-1, lane.right_edge_m), (1, lane.left_edge_m)):
            draw = 10 + 2 * index + (side > 0)
            if choice(10, stage.seed, Purpose.WALKER_PLACE, draw) < _WAITING_TENTHS:
                offset_m = side * (edge_m + stage.draw(*_WAITING_M, Purpose.WALKER_DISTANCE, draw))
                turn_rad = -side * math.pi / 2
                bodies.append(stage.standing(Kind.PEDESTRIAN, PEDESTRIAN, arc_m, offset_m, turn_rad=turn_rad))
    return bodies


def _furniture(stage: Stage) -> list[Body]:
    """Posts and bins at the roadside."""
    bodies = []
    for index in range(_FURNITURE):
        arc_m, offset_m = _roadside(stage, index, _VERGE_M, Purpose.FURNITURE_PLACE)
        bodies.append(stage.standing(Kind.STATIC, (POST, BIN)[index // 2], arc_m, offset_m))
    return bodies


def _walks_free(walker: Body, cast: Sequence[Body]) -> Body | None:
    """The walker, who stops before whatever stands in its way; ``None`` where something stands on its place."""
    travel_m = walker.travel_m
    cos, sin = math.cos(walker.yaw_rad), math.sin(walker.yaw_rad)
    for body in cast:
        if body.behaviour is not Behaviour.STANDING or body.kind is Kind.PEDESTRIAN:
            continue
        reach_m = math.hypot(body.size.length_m, body.size.width_m) / 2 + _KEPT_M
        dx, dy = body.x_m - walker.x_m, body.y_m - walker.y_m
        ahead_m, aside_m = cos * dx + sin * dy, abs(cos * dy - sin * dx)
        if aside_m < reach_m and -reach_m < ahead_m < travel_m + reach_m:
            if ahead_m < reach_m:
                return None
            travel_m = min(travel_m, ahead_m - reach_m)
    return replace(walker, travel_m=travel_m)


def populate(stage: Stage, ambient: Ambient, cast: Sequence[Body]) -> list[Body]:
    """Ambient bodies of a world, clear of the scenario's `cast`."""
    place = stage.tables.route.place
    bodies = _own_lane(stage, ambient)
    if ambient.oncoming:
        bodies += _oncoming(stage)
    if ambient.beside:
        bodies += _beside(stage) + _mainline(stage)
    if ambient.crossing:
        bodies += _crossing(stage)
    if ambient.parked:
        bodies += _parked(stage)
    if place in (Place.ROAD, Place.JUNCTION):
        furniture = _furniture(stage) if place is Place.ROAD else []
        standing = [*cast, *furniture]
        walkers = (_walks_free(walker, standing) for walker in _walkers(stage))
        bodies += [walker for walker in walkers if walker is not None] + furniture
    if place is Place.JUNCTION:
        bodies += _waiting(stage)
    return bodies
