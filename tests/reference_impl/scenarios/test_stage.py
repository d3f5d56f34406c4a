"""The stage: times and places on tracks fit each other, whichever way one asks."""

from __future__ import annotations

import numpy as np
import pytest
from tests.each import each
from tests.reference_impl.scenarios.playback import FRAME_S, playback
from tests.reference_impl.simulation.worlds import SCENARIO_NAMES, drive_of

from branchdrive.contract.timing import TICK_S
from branchdrive_reference.geometry.polyline import interpolate
from branchdrive_reference.noise import Purpose
from branchdrive_reference.scenarios.stage import Stage
from branchdrive_reference.town.route import START_M
from branchdrive_reference.town.track import EGO_TRACK, Role, route_tracks
from branchdrive_reference.world.body import Behaviour, Kind, Size

BOX = Size(4.0, 2.0, 1.5, 1000.0)
each_scenario = each("scenario", SCENARIO_NAMES)


def stage_of(scenario: str, number: int = 0) -> Stage:
    spec = drive_of(scenario, number).spec
    return Stage(route_tracks(spec.town, spec.route_id), spec.seed)


def drive_s(stage: Stage, track: int, from_m: float, to_m: float, eagerness: float) -> float:
    """Time over a stretch at the desired speed, integrated in small steps."""
    arc_m, time_s, step_s = from_m, 0.0, TICK_S / 10
    path = stage.tables.path(track)
    while arc_m < to_m:
        arc_m += step_s * eagerness * float(np.interp(arc_m, path["arc_m"], path["advisory_speed_mps"]))
        time_s += step_s
    return time_s


@each_scenario
def test_the_ego_arrives_when_it_drives_its_desired_speed(scenario: str) -> None:
    stage = stage_of(scenario)
    assert stage.ego_arrival_s(START_M) == 0.0
    driven_s = drive_s(stage, EGO_TRACK, START_M, stage.site_m, 1.0)
    assert stage.ego_arrival_s(stage.site_m) == pytest.approx(driven_s, rel=0.01)


@each("eagerness", [0.6, 1.0, 1.2])
@each_scenario
def test_a_lead_in_time_is_driven_in_that_time(scenario: str, eagerness: float) -> None:
    stage = stage_of(scenario)
    for track in range(len(stage.tables.tracks)):
        at_m = float(stage.tables.path(track)["arc_m"][-1]) - 60.0
        from_m = stage.arc_before(track, at_m, 4.0, eagerness)
        assert drive_s(stage, track, from_m, at_m, eagerness) == pytest.approx(4.0, rel=0.02)


@each_scenario
def test_leads_grow_the_way_also_before_a_track_begins(scenario: str) -> None:
    stage = stage_of(scenario)
    for track in range(len(stage.tables.tracks)):
        begin_m = float(stage.tables.path(track)["arc_m"][0])
        arcs = [stage.arc_before(track, begin_m + 30.0, lead_s) for lead_s in np.arange(0.0, 12.0, 0.5)]
        assert arcs[0] == pytest.approx(begin_m + 30.0)
        assert (np.diff(arcs) < 0).all()
        assert arcs[-1] < begin_m


@pytest.mark.parametrize("scenario", ["NonSignalizedJunctionLeftTurn", "BlockedIntersection", "EnterActorFlow"])
def test_tracks_meet_where_their_places_are_close(scenario: str) -> None:
    stage = stage_of(scenario)
    for track in set(stage.tables.conflicts["other"][stage.tables.conflicts["track"] == EGO_TRACK].tolist()):
        at_m, other_at_m = stage.meeting_m(track)
        x, y, _ = interpolate(stage.tables.path(EGO_TRACK), at_m, 0.0)
        line = stage.tables.path(track)
        assert np.hypot(line["x_m"] - x, line["y_m"] - y).min() < 3.0
        ox, oy, _ = interpolate(line, other_at_m, 0.0)
        ego = stage.tables.path(EGO_TRACK)
        assert np.hypot(ego["x_m"] - ox, ego["y_m"] - oy).min() < 3.0


def test_tracks_that_never_meet_are_refused() -> None:
    stage = stage_of("PedestrianCrossing")
    oncoming = stage.track(Role.ONCOMING)
    assert oncoming is not None
    with pytest.raises(LookupError, match="does not meet"):
        stage.meeting_m(oncoming)


def test_what_is_beside_is_nearest() -> None:
    stage = stage_of("HighwayCutIn")
    track = next(track for role in (Role.LEFT_LANE, Role.RIGHT_LANE) if (track := stage.track(role)) is not None)
    arc_m = stage.beside(stage.site_m, track)
    x, y, _ = interpolate(stage.tables.path(EGO_TRACK), stage.site_m, 0.0)
    bx, by, _ = interpolate(stage.tables.path(track), arc_m, 0.0)
    assert np.hypot(bx - x, by - y) == pytest.approx(3.5, abs=0.4)


@each_scenario
def test_the_site_lies_where_the_route_offers_it(scenario: str) -> None:
    stage = stage_of(scenario)
    low_m, high_m = stage.tables.route.site_m
    assert low_m <= stage.site_m <= high_m
    assert stage.site_m == stage_of(scenario).site_m


def test_draws_lie_in_their_interval_and_repeat() -> None:
    stage = stage_of("Accident")
    draws = [stage.draw(2.0, 3.0, Purpose.SCENARIO_PLACE, index) for index in range(50)]
    assert all(2.0 <= draw < 3.0 for draw in draws)
    assert len(set(draws)) == 50
    assert draws == [stage.draw(2.0, 3.0, Purpose.SCENARIO_PLACE, index) for index in range(50)]


def test_bodies_are_put_where_they_are_asked_for() -> None:
    stage = stage_of("PedestrianCrossing")
    x, y, yaw = interpolate(stage.tables.path(EGO_TRACK), stage.site_m, -2.0)
    standing = stage.standing(Kind.STATIC, BOX, stage.site_m, -2.0, turn_rad=0.5)
    driving = stage.vehicle(BOX, stage.site_m, offset_m=-2.0, eagerness=0.5)
    assert (standing.x_m, standing.y_m, standing.yaw_rad) == pytest.approx((x, y, yaw + 0.5))
    assert standing.behaviour is Behaviour.STANDING
    assert (driving.x_m, driving.y_m, driving.yaw_rad) == pytest.approx((x, y, yaw))
    assert driving.behaviour is Behaviour.FOLLOWING
    assert driving.speed_mps == pytest.approx(0.5 * stage.advisory_mps(stage.site_m))


def test_the_ego_arrives_as_forecast_where_nothing_holds_it_up() -> None:
    played = playback("OppositeVehicleTakingPriority", 0)
    forecast_s = played.stage.ego_arrival_s(60.0)
    driven_s = float(np.argmax(played.ego["arc_m"] > 60.0)) * FRAME_S
    assert driven_s == pytest.approx(forecast_s, abs=1.0)


def test_counts_reach_both_bounds_and_picks_every_option() -> None:
    stage = stage_of(SCENARIO_NAMES[0])
    counts = {stage.count((3, 5), Purpose.SCENARIO_COUNT, index) for index in range(100)}
    picks = {stage.pick("abc", Purpose.SCENARIO_BODY, index) for index in range(100)}
    assert counts == {3, 4, 5}
    assert picks == set("abc")
    assert stage.count((4, 4), Purpose.SCENARIO_COUNT) == 4
