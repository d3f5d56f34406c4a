"""What scenarios share: the light at the ego's arrival, and ways and times of the ego in the running scene."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference_impl.scenarios.playback import PLAYED, playback
from tests.reference_impl.simulation.worlds import drive_of

from branchdrive.contract.timing import TICK_S
from branchdrive_reference.scenarios.empty_road import EmptyRoad
from branchdrive_reference.scenarios.scenario import green_on_arrival
from branchdrive_reference.simulation.world import World
from branchdrive_reference.town.signal import NO_GROUP, Light, light_of
from branchdrive_reference.town.track import EGO_TRACK, route_tracks
from branchdrive_reference.world.body import EGO

SIGNALIZED = "BlockedIntersection"


def roads(scenario: str) -> list[EmptyRoad]:
    specs = [drive_of(scenario, number).spec for number in range(20)]
    return [EmptyRoad(route_tracks(spec.town, spec.route_id), spec.seed) for spec in specs]


@pytest.mark.parametrize("early_s", [-8.0, -2.0, 0.0, 1.0, 5.0])
def test_green_begins_as_early_as_asked(early_s: float) -> None:
    found = 0
    for road in roads(SIGNALIZED):
        track = road.tables.tracks[EGO_TRACK]
        if track["group"] == NO_GROUP:
            continue
        offset = green_on_arrival(road, early_s)
        begins = round((road.ego_arrival_s(float(track["stop_m"])) - early_s) / TICK_S)
        assert light_of(int(track["group"]), begins, offset) == Light.GREEN
        assert light_of(int(track["group"]), begins - 1, offset) != Light.GREEN
        found += 1
    assert found


def test_without_signals_there_is_no_offset() -> None:
    for road in roads("OppositeVehicleTakingPriority"):
        assert green_on_arrival(road, 3.0) == 0


@pytest.mark.parametrize("number", PLAYED)
def test_the_ego_comes_at_green_unless_a_scenario_needs_red(number: int) -> None:
    played = playback("OppositeVehicleRunningRedLight", number)
    track = played.tables.tracks[EGO_TRACK]
    reaches = int(np.argmax(played.ego["arc_m"] + played.ego["half_length_m"] > track["stop_m"]))
    assert played.lights[reaches, track["group"]] == Light.GREEN


def test_ways_and_times_are_of_the_front_of_the_ego() -> None:
    world = World(drive_of("ParkedObstacle", 0).spec)
    world.think()
    foot = world.feet[EGO_TRACK, EGO]
    way_m = world.scene.way_to_m(50.0)
    assert way_m == pytest.approx(50.0 - foot["arc_m"] - world.bodies["length_m"][EGO] / 2, abs=0.05)
    assert world.scene.time_to_s(50.0) == pytest.approx(way_m / foot["speed_mps"])


def test_a_standing_ego_takes_a_finite_time() -> None:
    world = World(drive_of("ParkedObstacle", 0).spec)
    world.think()
    world.feet[EGO_TRACK, EGO]["speed_mps"] = 0.0
    assert world.scene.time_to_s(50.0) == pytest.approx(world.scene.way_to_m(50.0))
