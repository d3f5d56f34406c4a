"""Overtaking: what stands or rides in the ego's lane is passed on the lane that the scenario's name promises."""

from __future__ import annotations

import numpy as np
from tests.each import Loop, each
from tests.reference_impl.scenarios.playback import PLAYED, Playback, playback

from branchdrive_reference.town.lane import LANE_WIDTH_M, LaneSide
from branchdrive_reference.world.body import EGO, Behaviour, Kind

STANDING = ("Accident", "ConstructionObstacle", "ParkedObstacle")
RIDING = ("HazardAtSideLane",)
ONE_WAY = (*STANDING, *RIDING)
TWO_WAYS = tuple(f"{name}TwoWays" for name in ONE_WAY)
each_world = each("number", PLAYED)


def everywhere(*names: str) -> Loop:
    return each("scenario", [name + ways for name in names for ways in ("", "TwoWays")])


def cast_at_start(played: Playback) -> np.ndarray:
    return played.bodies[0][list(played.cast)]


@each_world
@everywhere(*STANDING)
def test_what_stands_blocks_the_lane(scenario: str, number: int) -> None:
    played = playback(scenario, number)
    feet = played.feet[0, 0, list(played.cast)]
    assert (cast_at_start(played)["behaviour"] == Behaviour.STANDING).all()
    assert (np.abs(feet["offset_m"]) < LANE_WIDTH_M / 2).all()
    left, right = (feet["offset_m"] + feet["half_width_m"]).max(), (feet["offset_m"] - feet["half_width_m"]).min()
    free_m = max(LANE_WIDTH_M / 2 - left, right + LANE_WIDTH_M / 2)
    assert free_m < played.bodies["width_m"][0, EGO]


def beside_cast(played: Playback) -> np.ndarray:
    """When the ego is beside any of the cast ``[frames]``."""
    return np.any([played.passing(row) for row in played.cast], axis=0)


@each_world
@everywhere(*STANDING)
def test_the_ego_leaves_its_lane_and_passes(scenario: str, number: int) -> None:
    played = playback(scenario, number)
    offset = played.ego["offset_m"]
    assert abs(offset[0]) < 0.1
    assert np.abs(offset[beside_cast(played)]).max() > 1.0
    assert played.ego["arc_m"][-1] > played.along_route(played.cast[-1])["arc_m"][-1]


@everywhere(*STANDING)
def test_the_ego_returns_to_its_lane(scenario: str) -> None:
    """Unless it arrives while it is still passing."""
    returned = [abs(playback(scenario, number).ego["offset_m"][-1]) < 0.6 for number in PLAYED]
    assert np.mean(returned) > 0.5


@everywhere(*RIDING)
def test_the_ego_overtakes_cyclists(scenario: str) -> None:
    """Unless the other lane is not free before it arrives."""
    worlds = [playback(scenario, number) for number in PLAYED]
    overtaken = [
        played.ego["arc_m"][-1] > played.along_route(played.cast[0])["arc_m"][-1]
        and np.abs(played.ego["offset_m"][beside_cast(played)]).max() > 1.0
        for played in worlds
    ]
    assert np.mean(overtaken) >= 0.5


@each_world
@each("scenario", TWO_WAYS)
def test_on_two_way_roads_the_oncoming_lane_is_beside(scenario: str, number: int) -> None:
    played = playback(scenario, number)
    lane = played.route.site_lane
    assert lane.left is LaneSide.ONCOMING
    assert lane.right is not LaneSide.SAME_DIRECTION
    assert played.ego["offset_m"].min() > -1.0


@each_world
@each("scenario", [f"{name}TwoWays" for name in STANDING])
def test_on_two_way_roads_the_oncoming_lane_is_used(scenario: str, number: int) -> None:
    ego = playback(scenario, number).ego
    assert (ego["offset_m"] + ego["half_width_m"]).max() > LANE_WIDTH_M / 2


@each_world
@each("scenario", ONE_WAY)
def test_elsewhere_a_lane_of_the_own_direction_is_used(scenario: str, number: int) -> None:
    played = playback(scenario, number)
    lane, offset = played.route.site_lane, played.ego["offset_m"][beside_cast(played)]
    assert LaneSide.SAME_DIRECTION in (lane.left, lane.right)
    if np.abs(offset).max(initial=0.0) > 1.0:
        side = lane.left if offset[np.abs(offset).argmax()] > 0 else lane.right
        assert side is LaneSide.SAME_DIRECTION


@each_world
@everywhere("Accident")
def test_an_accident_is_three_vehicles_two_of_them_askew(scenario: str, number: int) -> None:
    played = playback(scenario, number)
    cast = cast_at_start(played)
    along = played.bodies["yaw_rad"][0][list(played.cast)] - cast["yaw_rad"][0]
    assert (cast["kind"] == Kind.VEHICLE).all()
    assert len(cast) == 3
    assert (np.abs(np.sin(along[1:])) > 0.1).all()


@each_world
@everywhere("ConstructionObstacle")
def test_a_construction_site_is_a_barrier_and_cones(scenario: str, number: int) -> None:
    cast = cast_at_start(playback(scenario, number))
    assert (cast["kind"] == Kind.STATIC).all()
    assert cast["width_m"][0] > 2 * cast["length_m"][0]
    assert (cast["height_m"][2:] < 1.0).sum() >= 2


@each_world
@everywhere("ParkedObstacle")
def test_one_thing_is_parked(scenario: str, number: int) -> None:
    cast = cast_at_start(playback(scenario, number))
    assert len(cast) == 1
    assert cast["kind"][0] in (Kind.VEHICLE, Kind.STATIC)


@each_world
@everywhere(*RIDING)
def test_cyclists_ride_at_the_side_of_the_lane(scenario: str, number: int) -> None:
    played = playback(scenario, number)
    for row in played.cast:
        foot = played.along_route(row)
        assert played.bodies["kind"][0, row] == Kind.CYCLE
        assert (foot["offset_m"] < -0.5).all()
        assert foot["arc_m"][0] > played.ego["arc_m"][0]
        assert np.median(foot["speed_mps"]) > 1.0
        assert np.median(foot["speed_mps"]) < 0.6 * played.ego["speed_mps"].max()
