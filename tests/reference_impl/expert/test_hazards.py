"""What the expert sees as a hazard: crossing pedestrians, conflicts off its lane, and obstacles that it passes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.each import each
from tests.reference_impl.geometry.paths import ROAD

from branchdrive_reference.expert.control import PLAN, Cause
from branchdrive_reference.expert.decision import decide
from branchdrive_reference.expert.forecast import crossing_gap_m
from branchdrive_reference.town.conflict import CONFLICT
from branchdrive_reference.town.lane import LaneSide
from branchdrive_reference.town.signal import NO_GROUP
from branchdrive_reference.town.track import TRACK
from branchdrive_reference.world.body import EGO, Behaviour, Body, Kind, Size, body_table
from branchdrive_reference.world.corridor import FOOT, NOBODY, find_feet, nearest_ahead, update_feet
from branchdrive_reference.world.vehicle import EGO_SIZE

CAR, WALKER = Size(4.6, 1.9, 1.5, 1500.0), Size(0.5, 0.6, 1.75, 75.0)


class Road:
    """A straight two-way road along x with the ego at its beginning, in the right lane."""

    def __init__(self, speed_mps: float, *others: Body, offset_m: float = 0.0, yaw_rad: float = 0.0) -> None:
        self.vertices = ROAD.copy()
        self.vertices["advisory_speed_mps"] = 10.0
        self.vertices["left_lane"] = LaneSide.ONCOMING
        self.tracks = np.array([(0, len(ROAD), math.inf, NO_GROUP, 0)], TRACK)
        self.conflicts = np.zeros(0, CONFLICT)
        self.lights = np.zeros(2, np.int64)
        ego = Body(Kind.VEHICLE, Behaviour.DRIVEN, EGO_SIZE, 0.0, offset_m, yaw_rad, speed_mps)
        self.bodies = body_table([ego, *others])
        self.feet = np.zeros((1, len(self.bodies)), FOOT)
        find_feet(self.feet, self.bodies, self.vertices, self.tracks)
        update_feet(self.feet, self.bodies, self.vertices, self.tracks)
        self.plan = np.zeros(1, PLAN)

    def decide(self) -> np.void:
        """The expert's decision."""
        decide(self.plan[0], self.bodies, self.feet, self.vertices, self.tracks, self.conflicts, self.lights)
        row: np.void = self.plan[0]
        return row


def car(x_m: float, y_m: float, speed_mps: float = 0.0, *, yaw_rad: float = 0.0, free: bool = False) -> Body:
    behaviour = Behaviour.FREE if free or speed_mps else Behaviour.STANDING
    return Body(Kind.VEHICLE, behaviour, CAR, x_m, y_m, yaw_rad, speed_mps)


def walker(x_m: float, y_m: float, speed_mps: float, *, yaw_rad: float = math.pi / 2) -> Body:
    return Body(Kind.PEDESTRIAN, Behaviour.WALKING, WALKER, x_m, y_m, yaw_rad, speed_mps, travel_m=20.0)


def crossing(road: Road) -> float:
    gap: float = crossing_gap_m(road.plan[0], road.bodies, road.feet[0])
    return gap


@each(
    ("body", "is_hazard"),
    [
        (walker(22.0, -3.0, 1.4), True),  # in the way when the ego arrives
        (walker(22.0, 1.0, 1.4), False),  # leaves before
        (walker(22.0, -8.0, 1.4), False),  # too far from the road to count yet
        (walker(22.0, -3.0, 1.4, yaw_rad=-math.pi / 2), False),  # walks away
        (walker(22.0, -3.0, 1.4, yaw_rad=0.0), False),  # walks along the road
        (walker(-6.0, -1.0, 1.4), False),  # behind
        (walker(22.0, 0.0, 0.0), True),  # stands on the road
        (car(22.0, -3.0), False),
    ],
)
def test_pedestrians_in_the_way_are_hazards(body: Body, is_hazard: bool) -> None:
    gap_m = crossing(Road(9.0, body))
    assert math.isfinite(gap_m) == is_hazard
    if is_hazard:
        assert gap_m == pytest.approx(22.0 - 0.3 - EGO_SIZE.length_m / 2, abs=0.1)


def test_the_expert_brakes_for_a_pedestrian_and_says_so() -> None:
    plan = Road(9.0, walker(16.0, -3.0, 1.4)).decide()
    assert plan["cause"] == Cause.PEDESTRIAN
    assert plan["brake"] > 0.1
    assert plan["target_speed_mps"] < 9.0


def test_a_free_road_is_cruised() -> None:
    plan = Road(10.0).decide()
    assert plan["cause"] == Cause.CRUISE
    assert plan["brake"] == 0.0
    assert plan["target_speed_mps"] == pytest.approx(10.0)


def test_an_oncoming_vehicle_conflicts_with_an_ego_on_the_wrong_side() -> None:
    oncoming = car(20.0, 3.5, 9.0, yaw_rad=math.pi)
    assert Road(9.0, oncoming).decide()["cause"] == Cause.CRUISE
    assert Road(9.0, oncoming, offset_m=3.5).decide()["cause"] in (Cause.CONFLICT, Cause.LEADER)
    assert Road(9.0, oncoming, offset_m=3.5).decide()["brake"] > 0.2


def test_an_obstacle_is_passed_on_the_left() -> None:
    plan = Road(9.0, car(40.0, -0.2)).decide()
    assert 2.0 < plan["shift_m"] < 3.5
    assert plan["begin_m"] < plan["full_m"] < 40.0 < plan["hold_m"] < plan["end_m"]
    assert plan["cause"] == Cause.CRUISE


@pytest.mark.parametrize(
    "body",
    [car(70.0, 3.5, 9.0, yaw_rad=math.pi), car(-6.0, 2.6, 12.0), car(6.0, 3.0, 5.0)],
    ids=["oncoming", "overtaking", "beside"],
)
def test_an_obstacle_is_not_passed_while_the_other_lane_is_needed(body: Body) -> None:
    plan = Road(9.0, car(40.0, -0.2), body).decide()
    assert plan["shift_m"] == 0.0


def test_the_expert_brakes_for_an_obstacle_that_it_cannot_pass_yet() -> None:
    plan = Road(9.0, car(24.0, -0.2), car(50.0, 3.5, 9.0, yaw_rad=math.pi)).decide()
    assert plan["cause"] == Cause.LEADER
    assert plan["brake"] > 0.1


def test_a_planned_shift_is_dropped_when_the_lane_does_not_stay_free() -> None:
    road = Road(9.0, car(40.0, -0.2), car(300.0, 3.5, 9.0, yaw_rad=math.pi))
    assert road.decide()["shift_m"] > 0
    road.bodies["x_m"][2] = 70.0
    update_feet(road.feet, road.bodies, road.vertices, road.tracks)
    assert road.decide()["shift_m"] == 0.0


def test_a_wreck_counts_as_an_obstacle_once_it_stands() -> None:
    assert Road(9.0, car(40.0, 0.0, free=True)).decide()["shift_m"] > 0
    assert Road(9.0, car(40.0, 0.0, 3.0, free=True)).decide()["shift_m"] == 0


def test_astray_the_expert_slows_down_and_steers_back() -> None:
    plan = Road(10.0, offset_m=-4.0, yaw_rad=-0.3).decide()
    assert plan["steer"] < 0
    assert plan["target_speed_mps"] < 9.0


def looks_ahead(feet: NDArray[np.void], half_width_m: float = 1.2) -> tuple[int, float]:
    return nearest_ahead(feet[0], EGO, 0.0, half_width_m)


def test_the_corridor_finds_the_nearest_body_ahead() -> None:
    road = Road(9.0, car(30.0, 0.5), car(20.0, 3.5), car(25.0, -1.0), car(-10.0, 0.0))
    assert looks_ahead(road.feet) == (3, pytest.approx(25.0 - 2.3 - EGO_SIZE.length_m / 2))
    assert looks_ahead(Road(9.0).feet) == (NOBODY, math.inf)
