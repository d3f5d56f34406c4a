"""Traffic follows its lanes and reacts to what the ego really does."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.reference_impl.simulation.worlds import spec_of
from tests.reference_impl.world.ground import ADVISORY_MPS, CAR, Ground, track

from branchdrive.contract.timing import TICK_S
from branchdrive_reference.simulation.world import World
from branchdrive_reference.world.body import EGO, Behaviour
from branchdrive_reference.world.vehicle import EGO_SIZE


@pytest.mark.parametrize("brake", [0.3, 1.0])
def test_a_follower_stops_behind_a_stopped_ego(brake: float) -> None:
    ground = Ground([track()], ego_mps=ADVISORY_MPS)
    follower = ground.vehicle_at(-25.0)
    ground.drive(300, (0.0, 0.0, brake))
    gap_m = ground.bodies["x_m"][EGO] - ground.bodies["x_m"][follower] - (EGO_SIZE.length_m + CAR.length_m) / 2
    assert not ground.contacts.hit.any()
    assert ground.bodies["speed_mps"][follower] < 0.2
    assert 0.5 < gap_m < 8.0


def test_a_follower_goes_on_when_the_ego_does() -> None:
    ground = Ground([track()], ego_mps=ADVISORY_MPS)
    follower = ground.vehicle_at(-25.0)
    ground.drive(200, (0.0, 0.0, 0.5))
    ground.drive(200)
    assert ground.bodies["speed_mps"][follower] > 0.7 * ADVISORY_MPS
    assert not ground.contacts.hit.any()


def test_drivers_keep_to_the_advisory_speed_and_their_eagerness() -> None:
    """Within the share by which their mood changes."""
    ground = Ground([track(left_m=200.0), track(), track(left_m=50.0)])
    rows = [ground.vehicle_at(-200.0, on_track, eagerness=eager) for on_track, eager in ((1, 0.7), (2, 1.2))]
    ground.drive(500)
    settled = ground.history["speed_mps"][300:, rows]
    assert settled.mean(axis=0) == pytest.approx([0.7 * ADVISORY_MPS, 1.2 * ADVISORY_MPS], rel=0.07)
    assert np.ptp(settled, axis=0).min() > 0.0


def test_a_commanded_acceleration_replaces_the_driver() -> None:
    ground = Ground([track(left_m=200.0), track()])
    row = ground.vehicle_at(-100.0, 1)
    ground.bodies["commanded_accel_mps2"][row] = -2.0
    ground.drive(40)
    assert ground.bodies["speed_mps"][row] == pytest.approx(ADVISORY_MPS - 2.0 * 40 * TICK_S)
    ground.bodies["commanded_accel_mps2"][row] = math.nan
    ground.drive(100)
    assert ground.bodies["speed_mps"][row] > ADVISORY_MPS - 2.0


def test_drivers_stop_for_whoever_stands_in_their_way() -> None:
    ground = Ground([track()])
    row = ground.vehicle_at(-60.0)
    ground.standing_at(0.0)
    ground.drive(300)
    assert -15.0 < ground.bodies["x_m"][row] < -CAR.length_m
    assert ground.bodies["speed_mps"][row] < 0.2


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
