"""Emergency braking: a leader that stops, somebody who steps out, a vehicle that takes the ego's right of way."""

from __future__ import annotations

import math

import numpy as np
import shapely
from tests.each import each
from tests.reference_impl.scenarios.playback import FRAME_S, PLAYED, Playback, playback
from tests.reference_impl.scenarios.test_population import outline

from branchdrive_reference.scenarios.scenario import FIRST_ROW
from branchdrive_reference.town.lane import LANE_WIDTH_M, LaneSide, Turn
from branchdrive_reference.town.signal import NO_GROUP, Light
from branchdrive_reference.town.track import EGO_TRACK
from branchdrive_reference.world.body import EGO, Behaviour, Kind

each_world = each("number", PLAYED)
STEPPING_OUT = ("DynamicObjectCrossing", "ParkingCrossingPedestrian", "PedestrianCrossing")
BEHIND_A_TURN = ("VehicleTurningRoute", "VehicleTurningRoutePedestrian")
TAKING_THE_RIGHT_OF_WAY = ("OppositeVehicleRunningRedLight", "OppositeVehicleTakingPriority")


def entered(played: Playback, row: int, arc_m: float) -> int:
    """Frame in which the front of a body is at an arc length of its track."""
    foot = played.on_own_track(row)
    frames = np.flatnonzero(foot["arc_m"] + foot["half_length_m"] > arc_m)
    assert frames.size
    return int(frames[0])


@each_world
def test_the_leader_brakes_hard_and_drives_on(number: int) -> None:
    played = playback("HardBrakeRoute", number)
    speed = played.bodies["speed_mps"][:, FIRST_ROW]
    slowest = int(speed.argmin())
    assert played.along_route(FIRST_ROW)["arc_m"][0] > played.ego["arc_m"][0]
    assert np.diff(speed).min() / FRAME_S < -4.0
    assert slowest > played.hazard
    assert speed[slowest] < 0.5 * speed[played.hazard]
    assert speed[-1] > speed[slowest] + 1.0
    assert (played.along_route(FIRST_ROW)["arc_m"] > played.ego["arc_m"]).all()


@each_world
@each("scenario", [*STEPPING_OUT, *BEHIND_A_TURN])
def test_somebody_waits_and_then_crosses_the_whole_road(scenario: str, number: int) -> None:
    played = playback(scenario, number)
    body, foot = played.bodies[:, FIRST_ROW], played.along_route(FIRST_ROW)
    walked_m = np.hypot(body["x_m"][-1] - body["x_m"][0], body["y_m"][-1] - body["y_m"][0])
    assert (body["behaviour"][: played.hazard] == Behaviour.STANDING).all()
    assert body["behaviour"][-1] == Behaviour.WALKING
    assert np.abs(foot["offset_m"][0]) > LANE_WIDTH_M / 2 + 0.3
    assert walked_m > np.abs(foot["offset_m"][0])
    assert body["kind"][0] == (Kind.CYCLE if scenario == "VehicleTurningRoute" else Kind.PEDESTRIAN)


@each_world
@each("scenario", [*STEPPING_OUT, *BEHIND_A_TURN])
def test_who_crosses_would_meet_an_ego_that_drives_on(scenario: str, number: int) -> None:
    """At the speed of the moment in which it sets out, the ego would be there while it is in the ego's way."""
    played = playback(scenario, number)
    start, ego = played.along_route(FIRST_ROW)[played.hazard], played.ego[played.hazard]
    speed = float(np.median(np.diff(played.along_route(FIRST_ROW)["offset_m"][played.hazard :][:8]))) / FRAME_S
    arrives_s = (start["arc_m"] - ego["arc_m"] - ego["half_length_m"]) / ego["speed_mps"]
    assert abs(start["offset_m"] + speed * arrives_s) < LANE_WIDTH_M / 2 + 1.0


@each_world
def test_a_container_hides_who_runs_out(number: int) -> None:
    played = playback("DynamicObjectCrossing", number)
    runner, hides = played.cast
    assert played.bodies["kind"][0, hides] == Kind.STATIC
    hidden = []
    for bodies in played.bodies[: played.hazard + 1]:
        sight = shapely.LineString([(bodies[row]["x_m"], bodies[row]["y_m"]) for row in (EGO, runner)])
        hidden.append(outline(bodies[hides]).intersects(sight))
    assert any(hidden)


@each_world
def test_the_pedestrian_steps_out_between_parked_vehicles(number: int) -> None:
    played = playback("ParkingCrossingPedestrian", number)
    walker, before, behind = (played.along_route(row)[0] for row in played.cast)
    assert played.route.site_lane.right is LaneSide.PARKING
    assert before["arc_m"] + before["half_length_m"] < walker["arc_m"] < behind["arc_m"] - behind["half_length_m"]
    for parked in (before, behind):
        assert walker["offset_m"] < parked["offset_m"] < -LANE_WIDTH_M / 2
    assert (played.bodies["kind"][0, list(played.cast)[1:]] == Kind.VEHICLE).all()


@each_world
@each("scenario", BEHIND_A_TURN)
def test_somebody_crosses_where_the_turn_ends(scenario: str, number: int) -> None:
    played = playback(scenario, number)
    assert played.route.turn is not Turn.STRAIGHT
    assert 0.0 < played.along_route(FIRST_ROW)["arc_m"][0] - played.route.junction_m[1] < 15.0


@each_world
def test_the_red_light_is_run_while_the_ego_has_green(number: int) -> None:
    played = playback("OppositeVehicleRunningRedLight", number)
    rival = int(played.bodies["track"][0, FIRST_ROW])
    own_group, other_group = played.tables.tracks["group"][[EGO_TRACK, rival]]
    frame = entered(played, FIRST_ROW, float(played.tables.tracks["stop_m"][rival]))
    assert own_group != other_group
    assert NO_GROUP not in (own_group, other_group)
    assert played.lights[frame, other_group] == Light.RED
    assert played.lights[frame, own_group] == Light.GREEN


@each_world
def test_priority_is_taken_from_the_ego(number: int) -> None:
    played = playback("OppositeVehicleTakingPriority", number)
    rival = int(played.bodies["track"][0, FIRST_ROW])
    rules = played.tables.conflicts
    rule = rules[(rules["track"] == rival) & (rules["other"] == EGO_TRACK)]
    assert rule["yields"].tolist() == [1]
    assert played.tables.tracks["group"][EGO_TRACK] == NO_GROUP


@each_world
@each("scenario", TAKING_THE_RIGHT_OF_WAY)
def test_the_rival_never_stops_and_meets_the_ego(scenario: str, number: int) -> None:
    played = playback(scenario, number)
    at_m, rival_at_m = played.road.meeting_m(int(played.bodies["track"][0, FIRST_ROW]))
    rival, ego = entered(played, FIRST_ROW, rival_at_m), entered(played, EGO, at_m)
    assert played.bodies["speed_mps"][: rival + 1, FIRST_ROW].min() > 2.0
    assert rival <= ego + math.ceil(1.0 / FRAME_S)
    assert (ego - rival) * FRAME_S < 8.0


@each_world
def test_the_intersection_is_blocked_behind_the_ego_s_way_through(number: int) -> None:
    played = playback("BlockedIntersection", number)
    blocker, ego = played.along_route(FIRST_ROW), played.ego
    assert blocker["arc_m"][0] > played.route.junction_m[1]
    assert abs(blocker["offset_m"][0]) < 0.5
    moves = int(np.argmax(played.bodies["speed_mps"][:, FIRST_ROW] > 0.5))
    assert moves > played.hazard
    assert ego["speed_mps"][: moves + 10].min() < 0.5
    assert (ego["arc_m"] < blocker["arc_m"]).all()
    assert blocker["speed_mps"][-1] > 2.0
