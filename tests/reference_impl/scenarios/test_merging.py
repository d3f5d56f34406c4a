"""Merging: cut-ins end in the ego's lane ahead of it, and the ego joins a flow or waits for a gap in it."""

from __future__ import annotations

import numpy as np
from tests.each import each
from tests.reference_impl.scenarios.playback import PLAYED, Playback, playback

from branchdrive_reference.expert.control import Cause
from branchdrive_reference.scenarios.scenario import FIRST_ROW
from branchdrive_reference.town.lane import LANE_WIDTH_M, LaneSide, RoadClass, Turn
from branchdrive_reference.town.route import Place
from branchdrive_reference.town.signal import NO_GROUP, Light
from branchdrive_reference.town.track import EGO_TRACK, Role
from branchdrive_reference.world.body import Behaviour, Kind

each_world = each("number", PLAYED)
each_entry = each("scenario", ["EnterActorFlow", "MergerIntoSlowTraffic"])
each_turn = each(
    ("scenario", "turn", "signalized"),
    [
        ("NonSignalizedJunctionLeftTurn", Turn.LEFT, False),
        ("NonSignalizedJunctionRightTurn", Turn.RIGHT, False),
        ("SignalizedJunctionLeftTurn", Turn.LEFT, True),
    ],
)


def ends_ahead_in_lane(played: Playback) -> bool:
    """Whether the first of the cast moves into the ego's lane, close ahead of it, after the hazard began."""
    foot, ego = played.along_route(FIRST_ROW), played.ego
    moved = np.flatnonzero((np.abs(foot["offset_m"]) < 0.5) & (foot["arc_m"] > ego["arc_m"]))
    return bool(moved.size) and moved[0] > played.hazard and foot["arc_m"][moved[0]] - ego["arc_m"][moved[0]] < 60.0


@each_world
def test_the_highway_cut_in_comes_from_the_next_lane(number: int) -> None:
    played = playback("HighwayCutIn", number)
    foot = played.along_route(FIRST_ROW)
    assert played.route.place is Place.MOTORWAY
    assert played.route.site_lane.road_class is RoadClass.MOTORWAY
    assert np.abs(np.abs(foot["offset_m"][: played.hazard]) - LANE_WIDTH_M).max() < 0.5
    assert foot["speed_mps"].min() > 5.0
    assert ends_ahead_in_lane(played)


@each_world
def test_the_static_cut_in_leaves_a_queue(number: int) -> None:
    played = playback("StaticCutIn", number)
    start = played.along_route(FIRST_ROW)[: played.hazard]
    assert (start["speed_mps"] == 0.0).all()
    assert played.route.site_lane.right is LaneSide.SAME_DIRECTION
    queue = [row for row in played.cast if row != FIRST_ROW]
    places = played.feet[0, EGO_TRACK, queue]
    assert len(queue) >= 2
    assert (played.bodies["behaviour"][0, queue] == Behaviour.STANDING).all()
    assert (np.abs(places["offset_m"] + LANE_WIDTH_M) < 0.7).all()
    assert places["arc_m"].min() < start["arc_m"][0] < places["arc_m"].max()
    assert ends_ahead_in_lane(played)


@each_world
def test_the_parking_cut_in_leaves_the_strip(number: int) -> None:
    played = playback("ParkingCutIn", number)
    start = played.along_route(FIRST_ROW)[: played.hazard]
    assert played.route.site_lane.right is LaneSide.PARKING
    assert (start["speed_mps"] == 0.0).all()
    assert (start["offset_m"] + start["half_width_m"] < -LANE_WIDTH_M / 2 + 0.3).all()
    assert ends_ahead_in_lane(played)


@each_world
@each_entry
def test_the_ego_enters_a_motorway_on_which_a_flow_drives(scenario: str, number: int) -> None:
    played = playback(scenario, number)
    mainline = played.tables.roles[Role.MAINLINE]
    assert played.route.place is Place.MERGE
    assert played.route.chain[0].road_class is RoadClass.RAMP
    assert len(played.cast) >= 6
    assert (played.bodies["track"][0, list(played.cast)] == mainline).all()


@each_world
@each_entry
def test_the_ego_joins_between_vehicles(scenario: str, number: int) -> None:
    played = playback(scenario, number)
    joined = int(np.argmax(played.ego["arc_m"] > played.route.junction_m[1]))
    assert joined > 0
    ahead_m = np.array([played.along_route(row)["arc_m"][joined] for row in played.cast]) - played.ego["arc_m"][joined]
    assert (ahead_m > 0).any()
    assert (ahead_m < 0).any()


def test_slow_traffic_is_slower_than_the_actor_flow() -> None:
    def speed(scenario: str) -> float:
        return float(np.mean([played.bodies["speed_mps"][0, list(played.cast)].mean() for played in worlds(scenario)]))

    def worlds(scenario: str) -> list[Playback]:
        return [playback(scenario, number) for number in PLAYED]

    assert speed("MergerIntoSlowTraffic") < 0.8 * speed("EnterActorFlow")


@each_world
@each_turn
def test_the_ego_turns_across_or_into_a_flow_with_priority(
    scenario: str, turn: Turn, signalized: bool, number: int
) -> None:
    played = playback(scenario, number)
    rival = int(played.bodies["track"][0, FIRST_ROW])
    rules = played.tables.conflicts
    rule = rules[(rules["track"] == EGO_TRACK) & (rules["other"] == rival)]
    assert played.route.turn is turn
    assert (played.tables.tracks["group"][EGO_TRACK] != NO_GROUP) == signalized
    assert rule["yields"].tolist() == [1]
    assert len(played.cast) >= 3


@each_world
@each_turn
def test_the_ego_waits_for_a_gap(scenario: str, turn: Turn, signalized: bool, number: int) -> None:
    played = playback(scenario, number)
    enter_m, rival_enter_m = played.road.meeting_m(int(played.bodies["track"][0, FIRST_ROW]))
    before = played.ego["arc_m"] + played.ego["half_length_m"] < enter_m
    waited = before & (played.plan["cause"] == Cause.PRIORITY)
    went = int(np.argmin(before))
    first_through = [played.on_own_track(row)["arc_m"][went] > rival_enter_m for row in played.cast]
    assert waited.any()
    assert played.ego["speed_mps"][before].min() < 0.6 * played.ego["speed_mps"][0]
    assert any(first_through)
    if signalized:
        group = played.tables.tracks["group"][EGO_TRACK]
        at_line = int(np.argmax(played.ego["arc_m"] > played.tables.tracks["stop_m"][EGO_TRACK]))
        assert played.lights[at_line, group] != Light.RED


@each_world
def test_several_cyclists_cross_behind_the_turn(number: int) -> None:
    played = playback("CrossingBicycleFlow", number)
    crossed = 0
    for row in played.cast:
        foot = played.along_route(row)
        assert played.bodies["kind"][0, row] == Kind.CYCLE
        at = int(np.argmax(foot["offset_m"] * foot["offset_m"][0] < 0))
        if at > 0:
            crossed += 1
            assert foot["arc_m"][at] > played.route.junction_m[1]
    assert played.route.turn is not Turn.STRAIGHT
    assert crossed >= 2
    before = played.ego["arc_m"] < played.route.junction_m[1]
    assert np.isin(played.plan["cause"][before], (Cause.PEDESTRIAN, Cause.CONFLICT, Cause.LEADER)).any()
