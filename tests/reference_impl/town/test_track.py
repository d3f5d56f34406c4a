"""Tracks: the arc length of the route, advisory speeds, and who drives beside and across it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose
from tests.reference_impl.town.towns import ROUTES, each_place, tables_of

from branchdrive_reference.geometry.box import wrap
from branchdrive_reference.geometry.polyline import Array, Polyline
from branchdrive_reference.town import track as track_module
from branchdrive_reference.town.crossroads import Control
from branchdrive_reference.town.lane import LANE_WIDTH_M, LaneSide
from branchdrive_reference.town.route import CRUISE_SHARE, Place
from branchdrive_reference.town.signal import NO_GROUP
from branchdrive_reference.town.town import town
from branchdrive_reference.town.track import EGO_TRACK, Role, route_tracks

SIDES = {Role.FROM_LEFT: 1.0, Role.FROM_RIGHT: -1.0}
ROLES = {
    Place.ROAD: {Role.EGO, Role.ONCOMING, Role.LEFT_LANE, Role.RIGHT_LANE},
    Place.JUNCTION: {Role.EGO, Role.OPPOSITE, Role.FROM_LEFT, Role.FROM_RIGHT},
    Place.MOTORWAY: {Role.EGO, Role.LEFT_LANE, Role.RIGHT_LANE},
    Place.MERGE: {Role.EGO, Role.MAINLINE, Role.LEFT_LANE},
}


NEAR_M = 15.0
"""Points of other tracks further from the route than this lie on other roads."""

FEW = 4
"""Every vertex of so many is compared with the route: vertices are closer to each other than lanes."""


def test_an_unknown_route_is_refused() -> None:
    with pytest.raises(KeyError):
        route_tracks("Reference01", "nowhere")


def test_tables_are_built_once() -> None:
    route = ROUTES[0]
    assert route_tracks(route.town, route.route_id) is route_tracks(route.town, route.route_id)


@each_place
def test_the_ego_track_shares_the_arc_length_of_the_route(place: Place) -> None:
    for tables in tables_of(place):
        line, path = tables.route.polyline, tables.path(EGO_TRACK)
        for name, truth in (("x_m", line.x_m), ("y_m", line.y_m)):
            assert_allclose(np.interp(line.arc_m, path["arc_m"], path[name]), truth, rtol=0, atol=0.02)
        assert path["arc_m"][-1] > line.length_m


@each_place
def test_arc_length_is_that_of_the_vertices(place: Place) -> None:
    for tables in tables_of(place)[::8]:
        for index in range(len(tables.tracks)):
            path = tables.path(index)
            steps_m = np.hypot(np.diff(path["x_m"]), np.diff(path["y_m"]))
            assert_allclose(np.diff(path["arc_m"]), steps_m, rtol=0, atol=1e-9)
            assert np.abs(np.diff(path["tangent_rad"])).max() < 0.3


@each_place
def test_tracks_of_a_route_are_those_of_its_place(place: Place) -> None:
    found = [set(tables.roles) for tables in tables_of(place)]
    assert set().union(*found) == ROLES[place]
    assert all(tables.roles[Role.EGO] == EGO_TRACK for tables in tables_of(place))
    assert all(sorted(tables.roles.values()) == list(range(len(tables.tracks))) for tables in tables_of(place))


@each_place
def test_advisory_speeds_obey_limits_and_curves(place: Place) -> None:
    for tables in tables_of(place):
        path = tables.path(EGO_TRACK)
        speed = path["advisory_speed_mps"]
        assert (speed > 1.0).all()
        assert (speed <= CRUISE_SHARE * tables.limit_mps + 1e-9).all()
        curvature = np.abs(np.gradient(path["tangent_rad"], path["arc_m"]))
        assert (curvature * speed**2).max() < 3.0, tables.route.route_id  # comfortable, m/s^2


def advisory_oracle(line: Polyline, limit_mps: Array) -> Array:
    """The same speeds, by a plain loop from the end."""
    curvature = np.abs(np.gradient(line.tangent_rad, line.arc_m))
    square = [
        min((CRUISE_SHARE * limit) ** 2, track_module._CURVE_ACCEL_MPS2 / max(bend, 1e-6))
        for limit, bend in zip(limit_mps.tolist(), curvature.tolist(), strict=True)
    ]
    for index in reversed(range(len(square) - 1)):
        step_m = line.arc_m[index + 1] - line.arc_m[index]
        square[index] = min(square[index], square[index + 1] + 2.0 * track_module._CURVE_BRAKE_MPS2 * step_m)
    return np.sqrt(square)


@st.composite
def roads(draw: st.DrawFn) -> tuple[Polyline, Array]:
    """A winding line and its limits."""
    count = draw(st.integers(3, 40))
    step_m = draw(arrays(float, count, elements=st.floats(0.3, 4.0)))
    turn_rad = draw(arrays(float, count, elements=st.floats(-0.4, 0.4)))
    heading = np.cumsum(turn_rad)
    line = Polyline(np.cumsum(step_m * np.cos(heading)), np.cumsum(step_m * np.sin(heading)))
    return line, draw(arrays(float, count, elements=st.floats(5.0, 35.0)))


@given(roads())
def test_advisory_speeds_are_those_of_a_plain_backwards_loop(road: tuple[Polyline, Array]) -> None:
    line, limit_mps = road
    found = track_module._advisory_speed_mps(line, limit_mps)
    assert_allclose(found, advisory_oracle(line, limit_mps), rtol=1e-9)
    assert (found <= CRUISE_SHARE * limit_mps + 1e-9).all()


def test_oncoming_traffic_passes_on_the_left_of_the_route() -> None:
    for tables in tables_of(Place.ROAD):
        line, path = tables.route.polyline, tables.path(tables.roles[Role.ONCOMING])[::FEW]
        foot = line.position(path["x_m"], path["y_m"])
        begin_m, end_m = tables.route.junction_m
        on_road = (foot.progress_m > 0.0) & (foot.progress_m < line.length_m) & (np.abs(foot.offset_m) < NEAR_M)
        assert np.ptp(foot.progress_m[on_road]) > 0.9 * line.length_m
        on_road &= (foot.progress_m < begin_m - 1.0) | (foot.progress_m > end_m + 1.0)
        assert foot.offset_m[on_road].min() > 0.9 * LANE_WIDTH_M, tables.route.route_id
        assert np.cos(path["tangent_rad"] - foot.heading_rad)[on_road].max() < -0.9


@pytest.mark.parametrize(("role", "side"), [(Role.LEFT_LANE, 1.0), (Role.RIGHT_LANE, -1.0)])
@pytest.mark.parametrize("place", [Place.ROAD, Place.MOTORWAY], ids=lambda place: place.value)
def test_other_lanes_run_one_lane_width_aside(place: Place, role: Role, side: float) -> None:
    checked = 0
    for tables in tables_of(place)[::3]:
        if role not in tables.roles:
            continue
        route, path = tables.route, tables.path(tables.roles[role])[::FEW]
        foot = route.polyline.position(path["x_m"], path["y_m"])
        begin_m = route.junction_m[1] if route.early else 0.0
        end_m = route.site_m[1]
        beside = (foot.progress_m > begin_m + 1.0) & (foot.progress_m < end_m) & (np.abs(foot.offset_m) < NEAR_M)
        assert np.ptp(foot.progress_m[beside]) > 0.9 * (end_m - begin_m)
        assert_allclose(foot.offset_m[beside], side * LANE_WIDTH_M, rtol=0, atol=0.1, err_msg=route.route_id)
        checked += 1
    assert checked


@each_place
def test_a_lane_on_the_left_or_right_is_marked_where_there_is_one(place: Place) -> None:
    for tables in tables_of(place):
        path, site = tables.path(EGO_TRACK), tables.route.site_lane
        aside_m = -2.0 if place is Place.JUNCTION else 2.0
        at = path[np.searchsorted(path["arc_m"], tables.route.site_m[0] + aside_m)]
        assert (LaneSide(at["left_lane"]), LaneSide(at["right_lane"])) == (site.left, site.right)


@pytest.mark.parametrize("role", SIDES, ids=lambda role: role.name)
def test_side_traffic_arrives_from_its_side(role: Role) -> None:
    for tables in tables_of(Place.JUNCTION):
        if role not in tables.roles:
            continue
        path, stop_m = tables.path(tables.roles[role]), tables.tracks["stop_m"][tables.roles[role]]
        before = path[np.searchsorted(path["arc_m"], stop_m - 10.0)]
        own = tables.route.chain[0].centre  # the ego's approach, and straight on
        dx, dy = before["x_m"] - own.x_m[-1], before["y_m"] - own.y_m[-1]
        to_left_m = dy * np.cos(own.tangent_rad[-1]) - dx * np.sin(own.tangent_rad[-1])
        assert SIDES[role] * to_left_m > 10.0, tables.route.route_id


def test_opposite_traffic_arrives_head_on() -> None:
    for tables in tables_of(Place.JUNCTION):
        if Role.OPPOSITE not in tables.roles:
            continue
        index = tables.roles[Role.OPPOSITE]
        headings = [
            np.interp(tables.tracks["stop_m"][track], tables.path(track)["arc_m"], tables.path(track)["tangent_rad"])
            for track in (EGO_TRACK, index)
        ]
        assert abs(wrap(float(headings[1] - headings[0]))) > math.radians(135.0)


@each_place
def test_lines_signs_and_signals_are_those_of_the_junction(place: Place) -> None:
    for tables in tables_of(place):
        route, track = tables.route, tables.tracks[EGO_TRACK]
        if not route.junction:
            assert math.isinf(track["stop_m"])
            assert track["group"] == NO_GROUP
            assert not track["stop_sign"]
            continue
        crossroads = town(route.town).junctions[route.junction]
        minor = route.chain[0].way[0] not in crossroads.major
        assert route.junction_m[0] - 3.0 < track["stop_m"] < route.junction_m[0]
        assert (track["group"] != NO_GROUP) == (crossroads.control is Control.SIGNAL)
        assert bool(track["stop_sign"]) == (crossroads.control is Control.STOP and minor)
