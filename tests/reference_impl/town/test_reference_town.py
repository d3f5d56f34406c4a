"""The reference town: lanes meet, keep to the right, and carry the routes and tracks that worlds need."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from branchdrive.contract.columns import PATTERNS
from branchdrive.contract.timing import CONTROL_HISTORY_TICKS, TICK_S
from branchdrive_reference.geometry.angle import wrap
from branchdrive_reference.town.lane import LaneSide, Turn
from branchdrive_reference.town.reference_town import JUNCTIONS, reference_town
from branchdrive_reference.town.road import LANE_WIDTH_M
from branchdrive_reference.town.route import CRUISE_SHARE, OVERRUN_M, START_M, town_routes
from branchdrive_reference.town.surface import town_surface
from branchdrive_reference.town.track import EGO_TRACK, NEIGHBOUR_TRACK, ONCOMING_TRACK, route_tracks

TOWN = reference_town()
ROUTES = town_routes(TOWN)


def test_every_lane_leads_somewhere_and_comes_from_somewhere() -> None:
    assert all(TOWN.successors[lane_id] and TOWN.predecessors[lane_id] for lane_id in TOWN.lanes)


@pytest.mark.parametrize("lane_id", list(TOWN.lanes))
def test_lanes_meet_in_place_and_direction(lane_id: str) -> None:
    lane = TOWN.lanes[lane_id]
    for following in TOWN.successors[lane_id]:
        gap_m = math.hypot(following.centre.x_m[0] - lane.centre.x_m[-1], following.centre.y_m[0] - lane.centre.y_m[-1])
        turn_rad = abs(wrap(float(following.centre.tangent_rad[0] - lane.centre.tangent_rad[-1])))
        assert gap_m < 1e-9
        assert turn_rad < 0.1
    assert re.fullmatch(PATTERNS["name"], lane_id)


def test_traffic_keeps_to_the_right() -> None:
    for (start, end), way in TOWN.carriageways.items():
        opposite = TOWN.carriageways[end, start].lanes[0].centre
        for index, lane in enumerate(way.lanes):
            middle = lane.centre.length_m / 2
            x, y = lane.centre.at(np.array([middle]))
            assert opposite.position(x, y).offset_m[0] == pytest.approx(LANE_WIDTH_M * (index + 1), abs=0.05)


def test_connectors_say_which_way_they_turn() -> None:
    for lane in TOWN.lanes.values():
        turned = wrap(float(lane.centre.tangent_rad[-1] - lane.centre.tangent_rad[0]))
        match lane.turn:
            case Turn.LEFT:
                assert turned > math.radians(40)
            case Turn.RIGHT:
                assert turned < -math.radians(40)
            case Turn.STRAIGHT:
                assert abs(turned) < math.radians(40)


def test_the_town_offers_many_separate_routes_of_every_kind() -> None:
    assert len(ROUTES) >= 100
    assert {(route.turn, route.early) for route in ROUTES.values()} == {
        (turn, early) for turn in (Turn.LEFT, Turn.RIGHT, Turn.STRAIGHT) for early in (True, False)
    }
    shapes = np.stack([np.stack(r.polyline.at(np.linspace(0, r.polyline.length_m, 32))) for r in ROUTES.values()])
    distance = np.sqrt(((shapes[:, None] - shapes[None]) ** 2).sum(axis=2).mean(axis=2))
    assert distance[~np.eye(len(shapes), dtype=bool)].min() > 2.0


@pytest.mark.parametrize("route_id", list(ROUTES))
def test_route_leaves_room_for_history_site_and_recovery(route_id: str) -> None:
    route = ROUTES[route_id]
    speed = CRUISE_SHARE * max(route.chain[0].speed_limit_mps, route.site_lane.speed_limit_mps)
    low, high = route.site_m
    assert low - 50.0 - START_M > CONTROL_HISTORY_TICKS * TICK_S * speed
    assert low < high < route.goal_m - 20.0
    assert route.polyline.length_m == pytest.approx(route.goal_m + OVERRUN_M)
    begin, end = route.junction_m
    assert end < low - 15.0 or begin > high + 15.0
    assert re.fullmatch(PATTERNS["id"], route_id)


@pytest.mark.parametrize("route_id", list(ROUTES)[::7])
def test_tracks_share_the_arc_length_of_the_route_and_never_cross(route_id: str) -> None:
    tables = route_tracks(route_id)
    line, path = tables.route.polyline, tables.path(EGO_TRACK)
    assert np.interp(line.arc_m, path["arc_m"], path["x_m"]) == pytest.approx(line.x_m, abs=1e-6)
    assert path["arc_m"][0] < -50.0
    assert path["arc_m"][-1] > line.length_m + 100.0
    assert (path["advisory_speed_mps"] <= CRUISE_SHARE * tables.limit_mps + 1e-9).all()
    for track in range(ONCOMING_TRACK, len(tables.tracks)):
        other = tables.path(track)
        near = line.position(other["x_m"], other["y_m"])
        crossing = (near.progress_m > 0) & (near.progress_m < line.length_m)
        if track == NEIGHBOUR_TRACK:  # spawned on the road of the site only, which begins behind the junction
            crossing &= near.progress_m > tables.route.junction_m[1] * tables.route.early
        assert np.abs(near.offset_m[crossing]).min() > 0.9 * LANE_WIDTH_M


def test_surface_names_the_lane_under_a_point() -> None:
    surface = town_surface(TOWN)
    lane = TOWN.lanes["b1-c1:0"]
    x, y = lane.centre.at(np.array([50.0]))
    normal = lane.centre.tangent_rad[50] + math.pi / 2
    found = surface.lanes_under(
        np.array([x[0], x[0] + 3.5 * math.cos(normal), x[0] - 3.5 * math.cos(normal)]),
        np.array([y[0], y[0] + 3.5 * math.sin(normal), y[0] - 3.5 * math.sin(normal)]),
    )
    assert found == ["b1-c1:0", "c1-b1:0", None]


def test_junctions_are_paved() -> None:
    surface = town_surface(TOWN)
    x, y = (np.array(values) for values in zip(*JUNCTIONS.values(), strict=True))
    assert surface.in_junction(x, y).all()
    assert not surface.in_junction(x + 40.0, y + 40.0).any()


def test_innermost_lanes_border_oncoming_traffic() -> None:
    for way in TOWN.carriageways.values():
        assert way.lanes[0].left is LaneSide.ONCOMING
        assert way.lanes[-1].right is LaneSide.NOTHING
