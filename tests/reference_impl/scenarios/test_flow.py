"""Flows pass a point one after the other at the times asked for, and a rival arrives together with the ego."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference_impl.scenarios.playback import PLAYED, playback
from tests.reference_impl.simulation.worlds import drive_of

from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.flow import arrive_with_ego, flow, rival_tracks, side_tracks
from branchdrive_reference.scenarios.scenario import FIRST_ROW
from branchdrive_reference.simulation.world import World
from branchdrive_reference.town.track import EGO_TRACK, Role, route_tracks
from branchdrive_reference.world.body import EGO, Heed

COUNT, HEADWAY_S, FIRST_S = 5, (1.5, 2.5), 6.0


def road_of(scenario: str, number: int = 0) -> EmptyRoad:
    spec = drive_of(scenario, number).spec
    return EmptyRoad(route_tracks(spec.town, spec.route_id), spec.seed)


def passing_times_s(road: EmptyRoad, track: int, at_m: float, eagerness: float) -> list[float]:
    """When each vehicle of a flow is at `at_m`, found by asking how far a lead brings it."""
    bodies = flow(road, track, at_m, FIRST_S, COUNT, HEADWAY_S, eagerness=eagerness)
    leads_s = np.arange(0.0, 40.0, 0.01)
    arcs_m = np.array([road.arc_before(track, at_m, lead_s, eagerness) for lead_s in leads_s])
    return [float(np.interp(-body.arc_m, -arcs_m, leads_s)) for body in bodies]


@pytest.mark.parametrize("eagerness", [0.5, 1.0])
def test_vehicles_follow_each_other_by_the_headway(eagerness: float) -> None:
    road = road_of("EnterActorFlow")
    track = road.tables.roles[Role.MAINLINE]
    times_s = passing_times_s(road, track, road.meeting_m(track)[1], eagerness)
    assert times_s[0] == pytest.approx(FIRST_S, abs=0.02)
    assert len(times_s) == COUNT
    assert (np.diff(times_s) >= HEADWAY_S[0] - 0.02).all()
    assert (np.diff(times_s) <= HEADWAY_S[1] + 0.02).all()


def test_a_flow_drives_on_its_track_at_its_desired_speed() -> None:
    road = road_of("EnterActorFlow")
    track = road.tables.roles[Role.MAINLINE]
    at_m = road.meeting_m(track)[1]
    for body in flow(road, track, at_m, FIRST_S, COUNT, HEADWAY_S, eagerness=0.7):
        assert (body.track, body.heeds, body.eagerness) == (track, Heed.ALL, 0.7)
        assert body.speed_mps == pytest.approx(0.7 * road.advisory_mps(body.arc_m, track))


@pytest.mark.parametrize("scenario", ["NonSignalizedJunctionLeftTurn", "OppositeVehicleTakingPriority"])
def test_rivals_are_those_who_meet_and_who_yields_says_the_rule(scenario: str) -> None:
    road = road_of(scenario)
    rules = road.tables.conflicts
    for ego_yields, (own, other) in ((True, ("track", "other")), (False, ("other", "track"))):
        for rival in rival_tracks(road, ego_yields=ego_yields):
            rule = rules[(rules[own] == EGO_TRACK) & (rules[other] == rival)]
            assert rival != EGO_TRACK
            assert (rule["yields"] == 1).all()
            assert len(rule)


@pytest.mark.parametrize("number", PLAYED)
def test_sides_come_across(number: int) -> None:
    tables = playback("OppositeVehicleRunningRedLight", number).tables
    sides = side_tracks(tables)
    assert sides
    for track in sides:
        headings = [
            float(np.interp(tables.tracks["stop_m"][row], tables.path(row)["arc_m"], tables.path(row)["tangent_rad"]))
            for row in (track, EGO_TRACK)
        ]
        assert abs(np.cos(headings[0] - headings[1])) < np.cos(np.radians(45.0))


@pytest.mark.parametrize("late_s", [-0.5, 0.0, 1.0])
def test_a_rival_arrives_with_the_ego(late_s: float) -> None:
    """Both fronts are at their places when asked for, if the ego keeps its speed."""
    world = World(drive_of("OppositeVehicleTakingPriority", 0).spec)
    world.think()
    scene = world.scene
    rival = world.bodies[FIRST_ROW]
    speed = float(world.bodies["speed_mps"][EGO])
    foot = scene.feet[EGO_TRACK, EGO]
    way_m, rival_way_m = 40.0, 42.0
    front_m = float(foot["arc_m"] + foot["half_length_m"])
    rival["speed_mps"], begin_m = 9.0, float(rival["arc_m"])
    rival_at_m = begin_m + rival["length_m"] / 2 + rival_way_m
    ticks, step_s = 0, 0.05
    while begin_m + rival["length_m"] / 2 + rival_way_m - rival["arc_m"] - rival["length_m"] / 2 > 0.0:
        foot["arc_m"] = front_m - foot["half_length_m"] + speed * step_s * ticks
        if scene.way_to_m(front_m + way_m) / speed + late_s < 0.5:
            break
        arrive_with_ego(scene, FIRST_ROW, front_m + way_m, float(rival_at_m), late_s)
        rival["speed_mps"] += rival["commanded_accel_mps2"] * step_s
        rival["arc_m"] += rival["speed_mps"] * step_s
        ticks += 1
    left_s = scene.way_to_m(front_m + way_m) / speed + late_s
    rival_left_s = (rival_at_m - rival["arc_m"] - rival["length_m"] / 2) / rival["speed_mps"]
    assert rival_left_s == pytest.approx(left_s, abs=0.25)


def test_a_rival_is_never_driven_harder_than_a_vehicle_can() -> None:
    world = World(drive_of("OppositeVehicleTakingPriority", 0).spec)
    world.think()
    for at_m in (-50.0, 0.0, 500.0):
        arrive_with_ego(world.scene, FIRST_ROW, 30.0, at_m, 0.0)
        assert abs(float(world.bodies["commanded_accel_mps2"][FIRST_ROW])) <= 4.0
