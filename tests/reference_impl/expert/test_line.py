"""The line before a junction: red lights, stop signs, and who has priority."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.reference_impl.world.ground import (
    ADVISORY_MPS,
    BEFORE_JUNCTION_M,
    HALF_JUNCTION_M,
    NORTH,
    SOUTH,
    Ground,
    Lights,
    course,
    track,
)

from branchdrive_reference.expert.control import Cause
from branchdrive_reference.town.lane import Turn
from branchdrive_reference.town.signal import Light
from branchdrive_reference.world.body import EGO

LINE_M = -HALF_JUNCTION_M - BEFORE_JUNCTION_M
STANDS_MPS = 0.2


def at_signal(lights: Lights, *, begin_m: float = -90.0) -> Ground:
    return Ground([track()], [course(group=0)], ego_m=begin_m, ego_mps=ADVISORY_MPS, lights=lights)


def at_sign() -> Ground:
    return Ground([track()], [course(major=False, stops=True)], ego_m=-80.0, ego_mps=ADVISORY_MPS)


def crossing(*, major: bool, heading_rad: float = NORTH) -> Ground:
    """The ego on a minor or major road, another road across it."""
    courses = [course(major=major), course(major=not major)]
    return Ground([track(), track(heading_rad)], courses, ego_m=-70.0, ego_mps=ADVISORY_MPS)


def test_the_expert_stops_at_red_before_the_line_and_goes_at_green() -> None:
    ground = at_signal(lambda tick: (Light.RED if tick < 320 else Light.GREEN, Light.RED))
    ground.drive(600)
    front_m, speed = ground.fronts_m(EGO), ground.history["speed_mps"][:, EGO]
    assert LINE_M - 4.0 < front_m[320] <= LINE_M
    assert np.abs(speed[300:320]).max() < STANDS_MPS
    assert front_m[-1] > HALF_JUNCTION_M
    assert speed[-1] > 0.7 * ADVISORY_MPS


def test_a_red_light_is_the_cause_of_the_stop() -> None:
    ground = at_signal(lambda _: (Light.RED, Light.RED))
    ground.drive(300)
    braking = ground.plans["brake"] > 0
    assert set(ground.plans["cause"][braking]) == {Cause.SIGNAL}


def test_green_is_passed_without_braking() -> None:
    ground = at_signal(lambda _: (Light.GREEN, Light.RED))
    ground.drive(240)
    assert ground.fronts_m(EGO)[-1] > HALF_JUNCTION_M
    assert ground.plans["brake"].max() == 0.0


def test_who_cannot_stop_at_yellow_any_more_goes_on() -> None:
    ground = at_signal(lambda _: (Light.YELLOW, Light.RED), begin_m=LINE_M - 12.0)
    ground.drive(80)
    assert ground.history["speed_mps"][:, EGO].min() > 0.9 * ADVISORY_MPS


def test_who_can_stop_at_yellow_does() -> None:
    ground = at_signal(lambda tick: (Light.YELLOW if tick < 60 else Light.RED, Light.RED), begin_m=-80.0)
    ground.drive(300)
    assert ground.fronts_m(EGO)[-1] <= LINE_M
    assert ground.history["speed_mps"][-1, EGO] < STANDS_MPS


def test_the_light_of_the_other_group_is_none_of_its_business() -> None:
    ground = at_signal(lambda _: (Light.GREEN, Light.RED))
    other = at_signal(lambda _: (Light.GREEN, Light.YELLOW))
    ground.drive(100)
    other.drive(100)
    assert ground.history.tobytes() == other.history.tobytes()


def test_the_expert_stops_once_at_a_stop_sign_then_goes() -> None:
    ground = at_sign()
    ground.drive(500)
    front_m, speed = ground.fronts_m(EGO), ground.history["speed_mps"][:, EGO]
    stands = speed < STANDS_MPS
    begins = np.flatnonzero(stands[1:] & ~stands[:-1])
    assert len(begins) == 1
    assert LINE_M - 4.0 < front_m[begins[0] + 1] <= LINE_M
    assert stands.sum() < 60
    assert front_m[-1] > HALF_JUNCTION_M


def test_a_stop_sign_is_remembered() -> None:
    ground = at_sign()
    ground.drive(500)
    stopped = ground.plans["stopped"].astype(bool)
    assert not stopped[0]
    assert stopped[-1]
    assert (np.diff(stopped.astype(int)) >= 0).all()


@pytest.mark.parametrize("heading_rad", [NORTH, SOUTH])
def test_on_a_minor_road_the_expert_lets_a_stream_pass(heading_rad: float) -> None:
    ground = crossing(major=False, heading_rad=heading_rad)
    stream = [ground.vehicle_at(-70.0 - 22.0 * index, 1) for index in range(4)]
    ground.drive(800)
    front_m = ground.fronts_m(EGO)
    passed = np.array([ground.fronts_m(row) for row in stream]) > 5.0
    enters = np.argmax(front_m > -1.0)
    assert passed[:, enters].all()
    assert front_m[-1] > HALF_JUNCTION_M
    assert not ground.contacts.hit.any()


def test_who_is_waited_for_is_the_cause() -> None:
    ground = crossing(major=False)
    for index in range(4):
        ground.vehicle_at(-70.0 - 22.0 * index, 1)
    ground.drive(200)
    assert Cause.PRIORITY in ground.plans["cause"][ground.plans["brake"] > 0]


def test_on_a_major_road_the_expert_drives_on_and_the_others_wait() -> None:
    ground = crossing(major=True)
    rival = ground.vehicle_at(-70.0, 1)
    ground.drive(500)
    assert ground.history["speed_mps"][:300, EGO].min() > 0.8 * ADVISORY_MPS
    ego_passed = np.argmax(ground.fronts_m(EGO) > 8.0)
    assert ground.fronts_m(rival)[ego_passed] < 0.0
    assert ground.fronts_m(rival)[-1] > HALF_JUNCTION_M


def test_a_left_turn_at_green_lets_the_opposite_side_pass() -> None:
    tracks = [track(), track(math.pi - 0.5)]
    ground = Ground(tracks, [course(Turn.LEFT, group=0), course(group=0)], ego_m=-60.0, ego_mps=ADVISORY_MPS)
    stream = [ground.vehicle_at(-60.0 - 22.0 * index, 1) for index in range(3)]
    ground.drive(700)
    enters = np.argmax(ground.fronts_m(EGO) > ground.conflicts["enter_m"][0])
    assert all(ground.fronts_m(row)[enters] > 0.0 for row in stream)
    assert ground.fronts_m(EGO)[-1] > HALF_JUNCTION_M
    assert not ground.contacts.hit.any()


def test_the_expert_keeps_deciding_while_overridden() -> None:
    """Full throttle towards a red light: the expert asks for the brake all the more."""
    ground = at_signal(lambda _: (Light.RED, Light.RED), begin_m=-70.0)
    ground.drive(80, (0.0, 0.8, 0.0))
    before = ground.fronts_m(EGO) < LINE_M
    brake = ground.plans["brake"][before]
    assert brake.max() > 0.5
    assert len(np.unique(brake)) > 5
    assert ground.fronts_m(EGO)[-1] > LINE_M
