"""The road: times and places on tracks fit each other, whichever way one asks."""

from __future__ import annotations

import numpy as np
import pytest
from tests.each import each
from tests.reference_impl.scenarios.playback import FRAME_S, playback
from tests.reference_impl.simulation.worlds import SCENARIO_NAMES, drive_of

from branchdrive.contract.timing import TICK_S
from branchdrive_reference.geometry.polyline import interpolate
from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.town.route import START_M
from branchdrive_reference.town.track import EGO_TRACK, Role, route_tracks
from branchdrive_reference.world.body import Behaviour, Kind, Size

BOX = Size(4.0, 2.0, 1.5, 1000.0)
each_scenario = each("scenario", SCENARIO_NAMES)


def road_of(scenario: str, number: int = 0) -> EmptyRoad:
    spec = drive_of(scenario, number).spec
    return EmptyRoad(route_tracks(spec.town, spec.route_id), spec.seed)


def drive_s(road: EmptyRoad, track: int, from_m: float, to_m: float, eagerness: float) -> float:
    """Time over a stretch at the desired speed, integrated in small steps."""
    arc_m, time_s, step_s = from_m, 0.0, TICK_S / 10
    path = road.tables.path(track)
    while arc_m < to_m:
        arc_m += step_s * eagerness * float(np.interp(arc_m, path["arc_m"], path["advisory_speed_mps"]))
        time_s += step_s
    return time_s


@each_scenario
def test_the_ego_arrives_when_it_drives_its_desired_speed(scenario: str) -> None:
    road = road_of(scenario)
    assert road.ego_arrival_s(START_M) == 0.0
    driven_s = drive_s(road, EGO_TRACK, START_M, road.site_m, 1.0)
    assert road.ego_arrival_s(road.site_m) == pytest.approx(driven_s, rel=0.01)


@each("eagerness", [0.6, 1.0, 1.2])
@each_scenario
def test_a_lead_in_time_is_driven_in_that_time(scenario: str, eagerness: float) -> None:
    road = road_of(scenario)
    for track in range(len(road.tables.tracks)):
        at_m = float(road.tables.path(track)["arc_m"][-1]) - 60.0
        from_m = road.arc_before(track, at_m, 4.0, eagerness)
        assert drive_s(road, track, from_m, at_m, eagerness) == pytest.approx(4.0, rel=0.02)


@each_scenario
def test_leads_grow_the_way_also_before_a_track_begins(scenario: str) -> None:
    road = road_of(scenario)
    for track in range(len(road.tables.tracks)):
        begin_m = float(road.tables.path(track)["arc_m"][0])
        arcs = [road.arc_before(track, begin_m + 30.0, lead_s) for lead_s in np.arange(0.0, 12.0, 0.5)]
        assert arcs[0] == pytest.approx(begin_m + 30.0)
        assert (np.diff(arcs) < 0).all()
        assert arcs[-1] < begin_m


@pytest.mark.parametrize("scenario", ["NonSignalizedJunctionLeftTurn", "BlockedIntersection", "EnterActorFlow"])
def test_tracks_meet_where_their_places_are_close(scenario: str) -> None:
    road = road_of(scenario)
    for track in set(road.tables.conflicts["other"][road.tables.conflicts["track"] == EGO_TRACK].tolist()):
        at_m, other_at_m = road.meeting_m(track)
        x, y, _ = interpolate(road.tables.path(EGO_TRACK), at_m, 0.0)
        line = road.tables.path(track)
        assert np.hypot(line["x_m"] - x, line["y_m"] - y).min() < 3.0
        ox, oy, _ = interpolate(line, other_at_m, 0.0)
        ego = road.tables.path(EGO_TRACK)
        assert np.hypot(ego["x_m"] - ox, ego["y_m"] - oy).min() < 3.0


def test_tracks_that_never_meet_are_refused() -> None:
    road = road_of("PedestrianCrossing")
    oncoming = road.track(Role.ONCOMING)
    assert oncoming is not None
    with pytest.raises(LookupError, match="does not meet"):
        road.meeting_m(oncoming)


def test_what_is_beside_is_nearest() -> None:
    road = road_of("HighwayCutIn")
    track = next(track for role in (Role.LEFT_LANE, Role.RIGHT_LANE) if (track := road.track(role)) is not None)
    arc_m = road.beside(road.site_m, track)
    x, y, _ = interpolate(road.tables.path(EGO_TRACK), road.site_m, 0.0)
    bx, by, _ = interpolate(road.tables.path(track), arc_m, 0.0)
    assert np.hypot(bx - x, by - y) == pytest.approx(3.5, abs=0.4)


@each_scenario
def test_the_site_lies_where_the_route_offers_it(scenario: str) -> None:
    road = road_of(scenario)
    low_m, high_m = road.tables.route.site_m
    assert low_m <= road.site_m <= high_m
    assert road.site_m == road_of(scenario).site_m


def test_draws_lie_in_their_interval_and_repeat() -> None:
    road = road_of("Accident")
    draws = [road.draw(2.0, 3.0, Purpose.SCENARIO_PLACE, index) for index in range(50)]
    assert all(2.0 <= draw < 3.0 for draw in draws)
    assert len(set(draws)) == 50
    assert draws == [road.draw(2.0, 3.0, Purpose.SCENARIO_PLACE, index) for index in range(50)]


def test_bodies_are_put_where_they_are_asked_for() -> None:
    road = road_of("PedestrianCrossing")
    x, y, yaw = interpolate(road.tables.path(EGO_TRACK), road.site_m, -2.0)
    standing = road.standing(Kind.STATIC, BOX, road.site_m, -2.0, turn_rad=0.5)
    driving = road.vehicle(BOX, road.site_m, offset_m=-2.0, eagerness=0.5)
    assert (standing.x_m, standing.y_m, standing.yaw_rad) == pytest.approx((x, y, yaw + 0.5))
    assert standing.behaviour is Behaviour.STANDING
    assert (driving.x_m, driving.y_m, driving.yaw_rad) == pytest.approx((x, y, yaw))
    assert driving.behaviour is Behaviour.FOLLOWING
    assert driving.speed_mps == pytest.approx(0.5 * road.advisory_mps(road.site_m))


def test_the_ego_arrives_as_forecast_where_nothing_holds_it_up() -> None:
    played = playback("OppositeVehicleTakingPriority", 0)
    forecast_s = played.road.ego_arrival_s(60.0)
    driven_s = float(np.argmax(played.ego["arc_m"] > 60.0)) * FRAME_S
    assert driven_s == pytest.approx(forecast_s, abs=1.0)


def test_counts_reach_both_bounds_and_picks_every_option() -> None:
    road = road_of(SCENARIO_NAMES[0])
    counts = {road.count((3, 5), Purpose.SCENARIO_COUNT, index) for index in range(100)}
    picks = {road.pick("abc", Purpose.SCENARIO_BODY, index) for index in range(100)}
    assert counts == {3, 4, 5}
    assert picks == set("abc")
    assert road.count((4, 4), Purpose.SCENARIO_COUNT) == 4
