"""Routes: many, separate, of every kind, and with room for what happens on them."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.distance import pdist
from tests.reference_impl.town.towns import ROUTES, each_place, routes_of

from branchdrive.contract.columns import PATTERNS
from branchdrive.contract.timing import ACTIVE_TICKS, CONTROL_HISTORY_TICKS, TICK_S
from branchdrive_reference.town.crossroads import Control
from branchdrive_reference.town.lane import LANE_WIDTH_M, LaneSide, RoadClass, Turn
from branchdrive_reference.town.route import CRUISE_SHARE, OVERRUN_M, START_M, Place, Route, obstacle_sight_m
from branchdrive_reference.town.town import TOWN_NAMES, town

POINTS = 32
FUTURE_S = ACTIVE_TICKS * TICK_S + 1.0
"""What a rollout needs behind the site: the intervention and its margin."""


def fastest_mps(route: Route) -> float:
    """Cruising speed on the fastest lane up to the site."""
    lanes = route.chain[: route.chain.index(route.site_lane) + 1]
    return CRUISE_SHARE * max(lane.speed_limit_mps for lane in lanes)


def test_there_are_many_separate_routes() -> None:
    """More than the 210 of the paper, apart by more than 2 m root mean square of points at equal shares."""
    assert len(ROUTES) >= 210
    share = np.linspace(0.0, 1.0, POINTS)
    shapes = np.array([np.concatenate(route.polyline.at(share * route.polyline.length_m)) for route in ROUTES])
    assert (pdist(shapes) / np.sqrt(POINTS)).min() >= 2.0


def test_identities_are_unique_and_recordable() -> None:
    assert len({(route.town, route.route_id) for route in ROUTES}) == len(ROUTES)
    assert all(re.fullmatch(PATTERNS["id"], route.route_id) for route in ROUTES)
    assert {route.town for route in ROUTES} == set(TOWN_NAMES)


def test_every_place_and_turn_is_offered() -> None:
    kinds = {(route.place, route.turn) for route in ROUTES}
    turns = (Turn.LEFT, Turn.RIGHT, Turn.STRAIGHT)
    assert kinds == {
        *((place, turn) for place in (Place.ROAD, Place.JUNCTION) for turn in turns),
        (Place.MOTORWAY, Turn.FOLLOW),
        (Place.MERGE, Turn.CHANGE_LEFT),
    }
    assert {route.early for route in routes_of(Place.ROAD)} == {True, False}


def test_every_control_is_met_with_every_turn() -> None:
    met = {(town(route.town).junctions[route.junction].control, route.turn) for route in routes_of(Place.JUNCTION)}
    assert met == {(control, turn) for control in Control for turn in (Turn.LEFT, Turn.RIGHT, Turn.STRAIGHT)}


def test_signs_are_met_from_major_and_minor_approaches() -> None:
    for control in (Control.STOP, Control.YIELD):
        majors = set()
        for route in routes_of(Place.JUNCTION):
            crossroads = town(route.town).junctions[route.junction]
            if crossroads.control is control:
                majors.add(route.chain[0].way[0] in crossroads.major)
        assert majors == {True, False}


@each_place
def test_a_route_follows_its_chain(place: Place) -> None:
    for route in routes_of(place)[::3]:
        network = town(route.town)
        assert all(after in network.successors[before.lane_id] for before, after in pairwise(route.chain))
        assert 0.0 <= route.begin_m < route.chain[0].centre.length_m
        assert route.site_lane in route.chain
        line = route.polyline
        away_m = np.min([np.abs(lane.centre.position(line.x_m, line.y_m).offset_m) for lane in route.chain], axis=0)
        assert away_m.max() < 0.02, route.route_id


@each_place
def test_a_route_goes_on_beyond_its_goal(place: Place) -> None:
    for route in routes_of(place):
        assert route.polyline.length_m == pytest.approx(route.goal_m + OVERRUN_M, abs=0.05), route.route_id


@each_place
def test_there_is_room_for_the_history_before_the_hazard_comes_into_sight(place: Place) -> None:
    for route in routes_of(place):
        speed = fastest_mps(route)
        seen_m = route.site_m[0] - obstacle_sight_m(speed)
        assert seen_m - START_M > CONTROL_HISTORY_TICKS * TICK_S * speed, route.route_id


@each_place
def test_there_is_room_for_the_recovery_behind_the_site(place: Place) -> None:
    for route in routes_of(place):
        begin_m, end_m = max(route.site_m[1], route.junction_m[1] * (place is Place.JUNCTION)), route.goal_m
        speed = CRUISE_SHARE * (route.chain[-1] if place is Place.JUNCTION else route.site_lane).speed_limit_mps
        assert end_m - begin_m > FUTURE_S * speed, route.route_id


def test_a_site_on_the_road_is_clear_of_the_junction() -> None:
    for route in routes_of(Place.ROAD):
        (low, high), (begin_m, end_m) = route.site_m, route.junction_m
        assert low < high
        assert (end_m < low - 15.0) if route.early else (begin_m > high + 15.0), route.route_id


def test_a_site_at_a_junction_is_where_the_route_enters_it() -> None:
    for route in routes_of(Place.JUNCTION):
        connector = route.chain[1]
        x, y = route.polyline.at(np.array(route.junction_m))
        assert np.hypot(x[0] - connector.centre.x_m[0], y[0] - connector.centre.y_m[0]) < 0.1
        assert np.hypot(x[1] - connector.centre.x_m[-1], y[1] - connector.centre.y_m[-1]) < 0.1
        assert route.site_m == (route.junction_m[0], route.junction_m[0])


def test_a_merge_is_where_the_entry_has_become_the_lane() -> None:
    for route in routes_of(Place.MERGE):
        ramp = route.chain[0]
        assert ramp.road_class is RoadClass.RAMP
        assert all(lane.road_class is RoadClass.MOTORWAY for lane in route.chain[1:])
        assert route.site_m[0] == pytest.approx(ramp.centre.length_m - route.begin_m, abs=10.0), route.route_id
        assert route.junction_m[1] == route.site_m[0]


def test_motorway_routes_keep_a_lane_that_has_one_to_its_left() -> None:
    for route in routes_of(Place.MOTORWAY):
        assert {lane.lane_id.rpartition(":")[2] for lane in route.chain} == {route.site_lane.lane_id.rpartition(":")[2]}
        assert all(lane.left is LaneSide.SAME_DIRECTION for lane in route.chain)
        assert route.junction == ""


def test_every_kind_of_place_is_reached_with_the_lane_width_of_the_town() -> None:
    assert {lane.width_m for route in ROUTES for lane in route.chain} == {LANE_WIDTH_M}
