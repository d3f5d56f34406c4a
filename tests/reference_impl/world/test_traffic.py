"""Traffic follows its lanes and reacts to what the ego really does."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference_impl.simulation.worlds import spec_of

from branchdrive_reference.simulation.world import World
from branchdrive_reference.town.track import EGO_TRACK
from branchdrive_reference.world.body import EGO, Behaviour


def world_with_follower() -> tuple[World, int]:
    """A world and the row of the vehicle behind the ego."""
    for number in range(20):
        world = World(spec_of("ParkedObstacle", number))
        world.think()
        arc, track = world.feet["arc_m"][EGO_TRACK], world.bodies["track"]
        behind = (world.bodies["behaviour"] == Behaviour.FOLLOWING) & (track == EGO_TRACK) & (arc < arc[EGO])
        if behind.any():
            return world, int(np.flatnonzero(behind)[0])
    raise AssertionError("no world has a follower")


@pytest.mark.parametrize("brake", [0.3, 1.0])
def test_a_follower_stops_behind_a_stopped_ego(brake: float) -> None:
    world, follower = world_with_follower()
    for _ in range(300):
        world.think()
        world.act(0.0, 0.0, brake)
    feet = world.feet[EGO_TRACK]
    gap_m = feet["arc_m"][EGO] - feet["arc_m"][follower] - feet["half_length_m"][EGO] - feet["half_length_m"][follower]
    assert not world.contacts.hit.any()
    assert world.bodies["speed_mps"][follower] < 0.2
    assert 0.5 < gap_m < 8.0


def test_vehicles_stay_on_their_tracks() -> None:
    world = World(spec_of("HardBrakeRoute"))
    for _ in range(200):
        world.think()
        plan = world.plan[0]
        world.act(float(plan["steer"]), float(plan["throttle"]), float(plan["brake"]))
    world.think()
    for index in np.flatnonzero(world.bodies["behaviour"] == Behaviour.FOLLOWING):
        body = world.bodies[index]
        foot = world.feet[body["track"], index]
        assert foot["offset_m"] == pytest.approx(body["offset_m"], abs=0.05)
        assert foot["arc_m"] == pytest.approx(body["arc_m"], abs=0.05)
        assert np.hypot(body["vel_x_mps"], body["vel_y_mps"]) == pytest.approx(body["speed_mps"], abs=0.3)


def test_nobody_moves_a_parked_body() -> None:
    world = World(spec_of("ParkedObstacle"))
    before = world.bodies[["x_m", "y_m", "yaw_rad"]][world.bodies["behaviour"] == Behaviour.STANDING].tolist()
    for _ in range(50):
        world.think()
        world.act(0.0, 0.2, 0.0)
    assert world.bodies[["x_m", "y_m", "yaw_rad"]][world.bodies["behaviour"] == Behaviour.STANDING].tolist() == before
