"""Contacts: momentum is shared, a body that is hit is free, and the physics goes on."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference_impl.world.driving import Plane

from branchdrive_reference.world.body import EGO, Behaviour, Body, Kind, Size
from branchdrive_reference.world.vehicle import EGO_SIZE

CAR = Size(4.6, 1.9, 1.5, 1600.0)
WALKER = Size(0.5, 0.6, 1.75, 75.0)


def standing(kind: Kind, size: Size, x_m: float) -> Body:
    return Body(kind, Behaviour.STANDING, size, x_m, 0.0, 0.0)


def test_a_hit_vehicle_is_pushed_and_the_ego_slows_down() -> None:
    plane = Plane(10.0, standing(Kind.VEHICLE, CAR, 8.0))
    ego = plane.drive(60)
    other = plane.bodies[1]
    assert plane.contacts.hit.tolist() == [False, True]
    assert other["behaviour"] == Behaviour.FREE
    assert other["x_m"] > 8.5
    assert ego["speed_mps"][-1] < 7.0
    gap_m = other["x_m"] - ego["x_m"][-1] - (CAR.length_m + EGO_SIZE.length_m) / 2
    assert gap_m > -0.1


def test_momentum_is_conserved_at_the_touch() -> None:
    plane = Plane(10.0, standing(Kind.VEHICLE, CAR, 8.0))
    before = None
    for _ in range(60):
        ego = plane.drive(1)[-1]
        if plane.contacts.hit[1]:
            other = plane.bodies[1]
            after = EGO_SIZE.mass_kg * ego["vel_x_mps"] + CAR.mass_kg * other["vel_x_mps"]
            assert after == pytest.approx(EGO_SIZE.mass_kg * before, rel=5e-3)
            return
        before = ego["vel_x_mps"]
    pytest.fail("the ego never reached the vehicle")


def test_a_pedestrian_hardly_slows_a_car() -> None:
    plane = Plane(8.0, standing(Kind.PEDESTRIAN, WALKER, 6.0))
    ego = plane.drive(30)
    assert plane.contacts.hit[1]
    assert ego["speed_mps"][-1] > 6.5
    assert plane.bodies[1]["speed_mps"] >= 0.0


def test_touching_is_reported_while_it_lasts() -> None:
    plane = Plane(5.0, standing(Kind.STATIC, Size(1.0, 4.0, 1.0, 1e6), 6.0))
    touching = []
    for _ in range(40):
        plane.drive(1, throttle=0.5)
        touching.append(bool(plane.contacts.touching[1]))
    first = touching.index(True)
    assert not any(touching[:first])
    assert sum(touching[first:]) > 5


def test_a_side_impact_turns_the_ego_and_tyres_stop_the_slide() -> None:
    other = Body(Kind.VEHICLE, Behaviour.FREE, CAR, 1.5, 4.0, -np.pi / 2, 12.0)
    plane = Plane(0.0, other)
    rows = plane.drive(80, brake=1.0)
    assert plane.contacts.hit[1]
    assert rows["y_m"][-1] < -0.2
    assert abs(rows["yaw_rad"][-1]) > 0.05
    assert np.abs(rows[["vel_x_mps", "vel_y_mps"]][-1].tolist()).max() < 1e-6
    assert EGO == 0


def test_actors_go_through_each_other_while_nobody_was_hit() -> None:
    plane = Plane(0.0, standing(Kind.VEHICLE, CAR, 20.0), standing(Kind.VEHICLE, CAR, 22.0))
    plane.drive(10)
    assert not plane.contacts.hit.any()
    assert plane.bodies["x_m"][1:].tolist() == [20.0, 22.0]


def test_who_is_hit_by_a_loose_body_is_loose_as_well() -> None:
    loose = Body(Kind.VEHICLE, Behaviour.FREE, CAR, 14.0, 0.0, 0.0, 10.0)
    plane = Plane(0.0, loose, standing(Kind.VEHICLE, CAR, 20.0))
    plane.drive(20)
    assert plane.bodies["behaviour"][2] == Behaviour.FREE
    assert plane.bodies["x_m"][2] > 20.5
    assert not plane.contacts.touching.any()
