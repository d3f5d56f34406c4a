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
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.scenario import Ambient
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


def _present(road: EmptyRoad, index: int, tenths: int) -> bool:
    return choice(10, road.seed, Purpose.TRAFFIC_PRESENCE, index) < tenths


def ambient_vehicle(road: EmptyRoad, index: int, arc_m: float, track: int) -> Body:
    """A vehicle with the size, desired speed and headway of draw `index`."""
    return road.vehicle(
        road.pick(VEHICLES, Purpose.TRAFFIC_BODY, index),
        arc_m,
        track,
        eagerness=road.draw(0.88, 1.05, Purpose.TRAFFIC_SPEED, index),
        headway_s=road.draw(1.0, 1.6, Purpose.TRAFFIC_HEADWAY, index),
    )


def _own_lane(road: EmptyRoad, ambient: Ambient) -> list[Body]:
    """A follower behind the ego, and a vehicle beyond the site, each present in most worlds."""
    bodies, headway_m = [], 1.6 * road.advisory_mps(START_M)
    if ambient.behind and _present(road, 0, 8):
        gap_m = headway_m + road.draw(0.0, 10.0, Purpose.TRAFFIC_GAP, 0)
        bodies.append(ambient_vehicle(road, 0, START_M - gap_m, EGO_TRACK))
    if ambient.ahead and _present(road, 1, 6):
        gap_m = road.draw(25.0, 50.0, Purpose.TRAFFIC_GAP, 1)
        bodies.append(ambient_vehicle(road, 1, road.site_m + gap_m, EGO_TRACK))
    return bodies


def _oncoming(road: EmptyRoad) -> list[Body]:
    """A queue of oncoming vehicles, closest first; in some worlds a cyclist rides last."""
    track = road.track(Role.ONCOMING)
    if track is None:
        return []
    bodies = []
    arc_m = road.beside(START_M, track) - road.draw(35.0, 60.0, Purpose.TRAFFIC_GAP, 10)
    for index in range(11, 11 + choice(_MAX_ONCOMING + 1, road.seed, Purpose.TRAFFIC_PRESENCE, 10)):
        bodies.append(ambient_vehicle(road, index, arc_m, track))
        arc_m -= road.draw(25.0, 75.0, Purpose.TRAFFIC_GAP, index)
    if _present(road, 20, 3):
        last_m = arc_m - _CYCLIST_BEHIND_M
        bodies.append(road.vehicle(BICYCLE, last_m, track, kind=Kind.CYCLE, offset_m=-1.1, eagerness=0.45))
    return bodies


def _beside(road: EmptyRoad) -> list[Body]:
    """Vehicles in the other lanes of the ego's direction, where there are any."""
    route = road.tables.route
    bodies = []
    for side, role in enumerate((Role.LEFT_LANE, Role.RIGHT_LANE)):
        track = road.track(role)
        if track is None:
            continue
        if route.place is Place.ROAD:
            begin_m = road.beside(route.junction_m[1] if route.early else START_M, track)
            gaps_m, tenths = _BESIDE_ON_ROADS_M, _BESIDE_ON_ROADS_TENTHS
        else:
            begin_m = road.beside(START_M, track)
            gaps_m, tenths = _BESIDE_ON_MOTORWAYS_M, _BESIDE_ON_MOTORWAYS_TENTHS
        for place, gap_m in enumerate(gaps_m):
            index = 30 + 5 * side + place
            if _present(road, index, tenths):
                arc_m = begin_m + gap_m + road.draw(0.0, 15.0, Purpose.TRAFFIC_GAP, index)
                bodies.append(ambient_vehicle(road, index, arc_m, track))
    return bodies


def _mainline(road: EmptyRoad) -> list[Body]:
    """Vehicles on the lane that an entry joins, spread around the ego's arrival."""
    track = road.track(Role.MAINLINE)
    if track is None:
        return []
    _, join_m = road.meeting_m(track)
    lead_s = road.ego_arrival_s(road.site_m)
    times_s = (-7.0, -3.5, 0.0, 3.5, 7.0)
    return [
        ambient_vehicle(road, index, road.arc_before(track, join_m, lead_s + time_s + jitter_s), track)
        for index, time_s in enumerate(times_s, 40)
        if _present(road, index, 6)
        for jitter_s in [road.draw(-0.8, 0.8, Purpose.TRAFFIC_GAP, index)]
    ]


def _crossing(road: EmptyRoad) -> list[Body]:
    """Up to two vehicles from each other side of the junction, at any time."""
    bodies = []
    for side, role in enumerate((Role.OPPOSITE, Role.FROM_LEFT, Role.FROM_RIGHT)):
        track = road.track(role)
        if track is None:
            continue
        line_m = float(road.tables.tracks[track]["stop_m"])
        for place, (low_m, high_m) in enumerate(((20.0, 70.0), (90.0, 140.0))):
            index = 50 + 2 * side + place
            if _present(road, index, 5):
                arc_m = line_m - road.draw(low_m, high_m, Purpose.TRAFFIC_GAP, index)
                bodies.append(ambient_vehicle(road, index, arc_m, track))
    return bodies


def _parked(road: EmptyRoad) -> list[Body]:
    """Parked vehicles on the strip beside the site; a gap around the site is left for scenarios."""
    if road.tables.route.site_lane.right is not LaneSide.PARKING or road.tables.route.place is not Place.ROAD:
        return []
    bodies = []
    for place, ahead_m in enumerate(_PARKED_AT_M):
        index = 70 + place
        if choice(10, road.seed, Purpose.PARKED_PRESENCE, index) < _PARKED_TENTHS:
            size = road.pick(VEHICLES, Purpose.TRAFFIC_BODY, index)
            arc_m = road.site_m + ahead_m + road.draw(-1.5, 1.5, Purpose.PARKED_PLACE, index)
            if _clear_m(road, arc_m) > size.length_m / 2:
                bodies.append(road.standing(Kind.VEHICLE, size, arc_m, PARKED_OFFSET_M))
    return bodies


def _roadside(road: EmptyRoad, index: int, margin_m: float, purpose: Purpose) -> tuple[float, float]:
    """Arc length and offset of roadside place `index`: right and left, first before and then behind the site."""
    left_m, right_m = road.edges_m()
    low, high = _STRETCHES_M[index // 2]
    arc_m = road.site_m + road.draw(low, high, purpose, index)
    return arc_m, left_m + margin_m if index % 2 else -right_m - margin_m


def _walkers(road: EmptyRoad) -> list[Body]:
    """Pedestrians that walk along the pavements of the road up to its junction; before it only if it is the site."""
    bodies = []
    places = (0, 1, 4, 5) if road.tables.route.place is Place.JUNCTION else range(_WALKERS)
    for index in places:
        margin_m = _PAVEMENT_M + _PASSING_M * (index // 2)
        arc_m, offset_m = _roadside(road, index, margin_m, Purpose.WALKER_PLACE)
        x, y, yaw = interpolate(road.tables.path(EGO_TRACK), arc_m, offset_m)
        speed = road.draw(0.7, 1.6, Purpose.WALKER_SPEED, index)
        heading = yaw + math.pi if choice(2, road.seed, Purpose.WALKER_HEADING, index) else yaw
        clear_m = _clear_m(road, arc_m)
        if clear_m > 0.0:
            towards_junction = (heading == yaw) == (arc_m < road.tables.route.junction_m[0])
            travel_m = min(_MOST_WALKED_M, clear_m if towards_junction else math.inf)
            bodies.append(Body(Kind.PEDESTRIAN, Behaviour.WALKING, PEDESTRIAN, x, y, heading, speed, travel_m=travel_m))
    return bodies


def _clear_m(road: EmptyRoad, arc_m: float) -> float:
    """Distance of a place on the roadside to the corners of the junction; negative inside."""
    begin_m, end_m = road.tables.route.junction_m
    return max(begin_m - arc_m, arc_m - end_m) - _CORNER_M


def _waiting(road: EmptyRoad) -> list[Body]:
    """Pedestrians who stand at the corners of the junction, on the ego's side of its mouths."""
    begin_m, end_m = road.tables.route.junction_m
    bodies = []
    first, last = road.tables.route.chain[0], road.tables.route.chain[-1]
    for index, (arc_m, lane) in enumerate(((begin_m - 2.0, first), (end_m + 2.0, last))):
        for side, edge_m in ((-1, lane.right_edge_m), (1, lane.left_edge_m)):
            draw = 10 + 2 * index + (side > 0)
            if choice(10, road.seed, Purpose.WALKER_PLACE, draw) < _WAITING_TENTHS:
                offset_m = side * (edge_m + road.draw(*_WAITING_M, Purpose.WALKER_DISTANCE, draw))
                turn_rad = -side * math.pi / 2
                bodies.append(road.standing(Kind.PEDESTRIAN, PEDESTRIAN, arc_m, offset_m, turn_rad=turn_rad))
    return bodies


def _furniture(road: EmptyRoad) -> list[Body]:
    """Posts and bins at the roadside."""
    bodies = []
    for index in range(_FURNITURE):
        arc_m, offset_m = _roadside(road, index, _VERGE_M, Purpose.FURNITURE_PLACE)
        bodies.append(road.standing(Kind.STATIC, (POST, BIN)[index // 2], arc_m, offset_m))
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


def populate(road: EmptyRoad, ambient: Ambient, cast: Sequence[Body]) -> list[Body]:
    """Ambient bodies of a world, clear of the scenario's `cast`."""
    place = road.tables.route.place
    bodies = _own_lane(road, ambient)
    if ambient.oncoming:
        bodies += _oncoming(road)
    if ambient.beside:
        bodies += _beside(road) + _mainline(road)
    if ambient.crossing:
        bodies += _crossing(road)
    if ambient.parked:
        bodies += _parked(road)
    if place in (Place.ROAD, Place.JUNCTION):
        furniture = _furniture(road) if place is Place.ROAD else []
        standing = [*cast, *furniture]
        walkers = (_walks_free(walker, standing) for walker in _walkers(road))
        bodies += [walker for walker in walkers if walker is not None] + furniture
    if place is Place.JUNCTION:
        bodies += _waiting(road)
    return bodies
