"""Leaving the lane: around groups of obstacles, past slow cyclists, and for a siren."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.reference_impl.world.ground import ADVISORY_MPS, CYCLE, Ground, track

from branchdrive_reference.town.lane import LANE_WIDTH_M, LaneSide
from branchdrive_reference.world.body import EGO, Heed, Kind

EDGE_M = 0.5 * LANE_WIDTH_M


def road(*, left: LaneSide = LaneSide.ONCOMING, right: LaneSide = LaneSide.NOTHING) -> Ground:
    """The ego's lane; track 1 is the lane to its left, driven the other way."""
    return Ground([track(left=left, right=right), track(np.pi, left_m=-LANE_WIDTH_M)], ego_mps=ADVISORY_MPS)


def offset_m(ground: Ground) -> NDArray[np.float64]:
    """The ego's offset to the left of its lane, before every tick driven."""
    offset: NDArray[np.float64] = ground.history["y_m"][:, EGO]
    return offset


def where(ground: Ground, begin_m: float, end_m: float) -> NDArray[np.bool_]:
    """Ticks at which the ego's centre is between two arc lengths."""
    x = ground.history["x_m"][:, EGO]
    inside: NDArray[np.bool_] = (x > begin_m) & (x < end_m)
    return inside


@pytest.mark.parametrize("gap_m", [8.0, 14.0])
def test_a_group_of_obstacles_is_passed_as_one(gap_m: float) -> None:
    ground = road()
    for index in range(3):
        ground.standing_at(60.0 + gap_m * index, -0.3)
    ground.drive(500)
    last_m = 60.0 + 2 * gap_m
    assert offset_m(ground)[where(ground, 58.0, last_m + 2.0)].min() > 1.5
    assert ground.bodies["x_m"][EGO] > last_m + 40.0
    assert abs(offset_m(ground)[-1]) < 0.3
    assert not ground.contacts.hit.any()


def test_obstacles_far_apart_are_passed_one_by_one() -> None:
    ground = road()
    for place_m in (60.0, 190.0):
        ground.standing_at(place_m, -0.3)
    ground.drive(700)
    assert np.abs(offset_m(ground)[where(ground, 115.0, 125.0)]).max() < 0.5
    for place_m in (60.0, 190.0):
        assert offset_m(ground)[where(ground, place_m - 1.0, place_m + 1.0)].min() > 1.5


@pytest.mark.parametrize(
    ("left", "right", "side"),
    [
        (LaneSide.SAME_DIRECTION, LaneSide.NOTHING, 1.0),
        (LaneSide.NOTHING, LaneSide.SAME_DIRECTION, -1.0),
        (LaneSide.ONCOMING, LaneSide.SAME_DIRECTION, -1.0),
        (LaneSide.ONCOMING, LaneSide.NOTHING, 1.0),
    ],
)
def test_a_lane_of_the_own_direction_is_preferred(left: LaneSide, right: LaneSide, side: float) -> None:
    ground = road(left=left, right=right)
    ground.standing_at(60.0)
    ground.drive(300)
    assert (side * offset_m(ground)[where(ground, 58.0, 62.0)]).min() > 1.5
    assert not ground.contacts.hit.any()


def test_without_a_lane_beside_it_the_expert_stops_behind_an_obstacle() -> None:
    ground = road(left=LaneSide.NOTHING)
    ground.standing_at(60.0)
    ground.drive(400)
    assert np.abs(offset_m(ground)).max() < 0.2
    assert ground.history["speed_mps"][-1, EGO] < 0.2
    assert 40.0 < ground.bodies["x_m"][EGO] < 56.0


def test_the_expert_waits_for_oncoming_traffic_and_passes_behind_it() -> None:
    ground = road()
    ground.standing_at(60.0, -0.3)
    stream = [ground.vehicle_at(-90.0 - 30.0 * index, 1) for index in range(3)]
    ground.drive(900)
    x = ground.history["x_m"]
    leaves = np.argmax(offset_m(ground) > EDGE_M)
    assert leaves > 0
    assert (x[leaves, stream] < x[leaves, EGO]).all()
    assert ground.bodies["x_m"][EGO] > 80.0
    assert not ground.contacts.hit.any()


def test_a_slow_cyclist_is_overtaken() -> None:
    ground = road()
    cyclist = ground.vehicle_at(40.0, speed_mps=3.5, size=CYCLE, kind=Kind.CYCLE, eagerness=0.35)
    ground.drive(500)
    x = ground.history["x_m"]
    beside = np.abs(x[:, EGO] - x[:, cyclist]) < 1.0
    assert beside.any()
    assert offset_m(ground)[beside].min() > 1.3
    assert ground.bodies["x_m"][EGO] > ground.bodies["x_m"][cyclist] + 20.0
    assert abs(offset_m(ground)[-1]) < 0.3
    assert not ground.contacts.hit.any()


def test_a_fast_cyclist_is_followed() -> None:
    ground = road()
    cyclist = ground.vehicle_at(40.0, speed_mps=7.5, size=CYCLE, kind=Kind.CYCLE, eagerness=0.75)
    ground.drive(400)
    assert np.abs(offset_m(ground)).max() < 0.3
    assert ground.bodies["x_m"][EGO] < ground.bodies["x_m"][cyclist]


@pytest.mark.parametrize(("right", "side"), [(LaneSide.SAME_DIRECTION, -1.0), (LaneSide.NOTHING, 1.0)])
def test_the_expert_makes_way_for_a_siren_and_returns_after_it(right: LaneSide, side: float) -> None:
    """To the right where there is a lane, otherwise to the left."""
    ground = road(left=LaneSide.SAME_DIRECTION, right=right)
    ambulance = ground.vehicle_at(-60.0, speed_mps=15.0, eagerness=1.5, heeds=Heed.NOTHING, siren=True)
    ground.drive(600)
    x = ground.history["x_m"]
    beside = np.abs(x[:, EGO] - x[:, ambulance]) < 2.0
    assert beside.any()
    assert (side * offset_m(ground)[beside]).min() > 0.8 * LANE_WIDTH_M
    assert ground.bodies["x_m"][ambulance] > ground.bodies["x_m"][EGO] + 20.0
    assert abs(offset_m(ground)[-1]) < 0.3
    assert not ground.contacts.hit.any()


def test_nobody_without_a_siren_is_made_way_for() -> None:
    ground = road(left=LaneSide.SAME_DIRECTION, right=LaneSide.SAME_DIRECTION)
    ground.vehicle_at(-40.0, speed_mps=15.0, eagerness=1.5)
    ground.drive(300)
    assert np.abs(offset_m(ground)).max() < 0.2


def test_the_expert_does_not_make_way_onto_somebody() -> None:
    ground = road(right=LaneSide.SAME_DIRECTION)
    ground.vehicle_at(-60.0, speed_mps=15.0, eagerness=1.5, heeds=Heed.NOTHING, siren=True)
    ground.standing_at(30.0, -LANE_WIDTH_M)
    ground.drive(500)
    assert not ground.contacts.hit.any()
