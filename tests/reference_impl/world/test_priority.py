"""Right of way: whom drivers wait for, where, and when they go."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.reference_impl.world.ground import (
    ADVISORY_MPS,
    BEFORE_JUNCTION_M,
    CAR,
    HALF_JUNCTION_M,
    NORTH,
    SOUTH,
    Ground,
    Lights,
    course,
    track,
)

from branchdrive_reference.town.lane import Turn
from branchdrive_reference.town.signal import Light
from branchdrive_reference.world import priority
from branchdrive_reference.world.body import Heed
from branchdrive_reference.world.priority import halt_gap_m, travel_s

LINE_M = -HALF_JUNCTION_M - BEFORE_JUNCTION_M
MINOR, MAJOR = 1, 2
GREEN, RED = (Light.GREEN, Light.GREEN), (Light.RED, Light.RED)


def halt_gap(ground: Ground, row: int, *, heeds: Heed = Heed.ALL, margin_s: float = 1.0) -> float:
    """Way that a body's front has until it has to stop."""
    gap_m, _ = halt_gap_m(
        ground.bodies, ground.feet, ground.tracks, ground.conflicts, ground.lights,
        int(ground.bodies["track"][row]), row, int(heeds), margin_s,
    )  # fmt: skip
    return gap_m


def crossing(*, heading_rad: float = NORTH) -> Ground:
    """A minor track to the east and a major one across it; the ego's track lies elsewhere."""
    tracks = [track(left_m=200.0), track(), track(heading_rad)]
    return Ground(tracks, [course(), course(major=False), course()])


def signals(lights: Lights) -> Ground:
    """One track with a signal."""
    return Ground([track(left_m=200.0), track()], [course(), course(group=0)], lights=lights)


@given(st.floats(0.1, 120.0), st.floats(0.0, 25.0))
def test_travel_time_is_that_of_fine_integration(way_m: float, speed_mps: float) -> None:
    """Speeding up to the crossing speed, or keeping a higher speed."""
    step_s = 2e-3
    time = np.arange(0.0, 60.0, step_s)
    speed = np.maximum(speed_mps, np.minimum(speed_mps + priority._START_ACCEL_MPS2 * time, priority._CROSSING_MPS))
    way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * step_s)])
    truth_s = math.inf if way[-1] < way_m else float(np.interp(way_m, way, time))
    found_s = travel_s(way_m, speed_mps)
    assert found_s == pytest.approx(truth_s, abs=0.01) or (math.isinf(truth_s) and found_s > time[-2])


def test_travel_over_no_way_takes_no_time() -> None:
    assert travel_s(0.0, 5.0) == travel_s(-3.0, 0.0) == 0.0


@pytest.mark.parametrize("heading_rad", [NORTH, SOUTH])
def test_minor_waits_for_major_at_its_line(heading_rad: float) -> None:
    ground = crossing(heading_rad=heading_rad)
    own, rival = ground.vehicle_at(-50.0, MINOR), ground.vehicle_at(-50.0, MAJOR)
    assert halt_gap(ground, own) == pytest.approx(LINE_M + 50.0 - CAR.length_m / 2)
    assert math.isinf(halt_gap(ground, rival))


def test_who_comes_late_enough_is_no_reason_to_wait() -> None:
    ground = crossing()
    own = ground.vehicle_at(-38.0, MINOR)
    ground.vehicle_at(-88.0, MAJOR)
    assert math.isinf(halt_gap(ground, own))
    assert math.isfinite(halt_gap(ground, own, margin_s=10.0))


def test_who_has_passed_is_no_reason_to_wait() -> None:
    ground = crossing()
    own = ground.vehicle_at(-38.0, MINOR)
    ground.vehicle_at(6.0, MAJOR)
    assert math.isinf(halt_gap(ground, own))


def test_who_is_in_the_way_is_a_reason_to_wait_even_at_standstill() -> None:
    ground = crossing()
    own = ground.vehicle_at(-40.0, MINOR)
    ground.vehicle_at(0.0, MAJOR, speed_mps=0.0)
    assert math.isfinite(halt_gap(ground, own))


@pytest.mark.parametrize(("halts_m", "waits"), [(-10.0, False), (20.0, True), (math.inf, True)])
def test_who_means_to_halt_before_the_conflict_is_no_reason_to_wait(halts_m: float, waits: bool) -> None:
    ground = crossing()
    own, rival = ground.vehicle_at(-50.0, MINOR), ground.vehicle_at(-50.0, MAJOR)
    ground.bodies["halt_m"][rival] = halts_m
    assert math.isfinite(halt_gap(ground, own)) == waits


def test_who_stands_before_the_conflict_is_no_reason_to_wait() -> None:
    ground = crossing()
    own = ground.vehicle_at(-50.0, MINOR)
    ground.vehicle_at(-20.0, MAJOR, speed_mps=0.0)
    assert math.isinf(halt_gap(ground, own))


def test_who_does_not_heed_priority_waits_for_nobody() -> None:
    ground = crossing()
    own = ground.vehicle_at(-50.0, MINOR)
    ground.vehicle_at(-50.0, MAJOR)
    for heeds in (Heed.NOTHING, Heed.SIGNALS):
        assert math.isinf(halt_gap(ground, own, heeds=heeds))


@pytest.mark.parametrize(("speed_mps", "waits"), [(5.0, True), (10.0, False)])
def test_who_cannot_stop_any_more_goes_on(speed_mps: float, waits: bool) -> None:
    """From 10 m/s with 3 m left nobody stops: ``100 / 6 > 16 m/s^2``; from 5 m/s it takes about 4 m/s^2."""
    ground = crossing()
    own = ground.vehicle_at(LINE_M - CAR.length_m / 2 - 3.0, MINOR, speed_mps=speed_mps)
    ground.vehicle_at(-22.0, MAJOR)
    assert math.isfinite(halt_gap(ground, own)) == waits


@pytest.mark.parametrize("light", list(Light))
def test_red_and_yellow_hold_whoever_can_stop(light: Light) -> None:
    ground = signals(lambda _: (light, Light.RED))
    own = ground.vehicle_at(-80.0, 1)
    assert math.isinf(halt_gap(ground, own)) == (light is Light.GREEN)


def test_yellow_asks_for_softer_braking_than_red() -> None:
    found = []
    for light in (Light.YELLOW, Light.RED):
        ground = signals(lambda _, light=light: (light, Light.RED))
        own = ground.vehicle_at(LINE_M - CAR.length_m / 2 - 14.0, 1)  # 3.6 m/s^2 to the line
        found.append(math.isfinite(halt_gap(ground, own)))
    assert found == [False, True]


def test_a_left_turn_waits_inside_the_junction() -> None:
    """At signals a left turn waits before the opposite side, not at the line."""
    turning, opposite = track(), track(math.pi - 0.4)
    ground = Ground(
        [track(left_m=200.0), turning, opposite],
        [course(), course(Turn.LEFT, group=0), course(group=0)],
    )
    own = ground.vehicle_at(-30.0, 1)
    ground.vehicle_at(-30.0, 2)
    enter_m = ground.conflicts["enter_m"][ground.conflicts["track"] == 1][0]
    front_m = -30.0 + CAR.length_m / 2
    assert LINE_M - front_m + 3.0 < halt_gap(ground, own) < enter_m - front_m


def test_a_driver_stops_at_red_before_the_line_and_starts_at_green() -> None:
    ground = signals(lambda tick: RED if tick < 300 else GREEN)
    own = ground.vehicle_at(-80.0, 1)
    ground.drive(600)
    front_m, speed = ground.fronts_m(own), ground.history["speed_mps"][:, own]
    assert front_m[300] <= LINE_M + 1e-6
    assert front_m[300] > LINE_M - 3.0
    assert speed[290:300].max() < 0.2
    assert front_m[-1] > HALF_JUNCTION_M
    assert speed[-1] > 0.7 * ADVISORY_MPS


def test_who_heeds_nothing_runs_the_red_light() -> None:
    ground = signals(lambda _: RED)
    own = ground.vehicle_at(-80.0, 1, heeds=Heed.NOTHING)
    ground.drive(250)
    assert ground.fronts_m(own)[-1] > HALF_JUNCTION_M
    assert ground.history["speed_mps"][:, own].min() > 0.8 * ADVISORY_MPS


def test_minor_lets_a_stream_pass_and_goes_behind_it() -> None:
    ground = crossing()
    own = ground.vehicle_at(-60.0, MINOR)
    stream = [ground.vehicle_at(-60.0 - 25.0 * index, MAJOR) for index in range(3)]
    ground.drive(700)
    history = ground.history
    together = [(np.abs(history["x_m"][:, own]) < 3.0) & (np.abs(history["y_m"][:, rival]) < 3.0) for rival in stream]
    assert not np.any(together)
    arrived = np.argmax(history["x_m"][:, own] > 0.0)
    assert all(history["y_m"][arrived, rival] > 0.0 for rival in stream)
    assert history["speed_mps"][:, stream].min() > 0.85 * ADVISORY_MPS


def test_between_equals_the_right_goes_first() -> None:
    """Who drives north comes from the right of who drives east."""
    ground = Ground([track(left_m=200.0), track(), track(NORTH)], [course()] * 3)
    own, right = ground.vehicle_at(-60.0, 1), ground.vehicle_at(-60.0, 2)
    ground.drive(500)
    history = ground.history
    assert np.argmax(history["y_m"][:, right] > 0.0) < np.argmax(history["x_m"][:, own] > 0.0)
    assert history["x_m"][-1, own] > 0.0


def test_a_follower_of_the_ego_has_the_priority_of_its_track() -> None:
    ground = Ground([track(), track(NORTH)], [course(), course(major=False)], ego_m=60.0, ego_mps=10.0)
    own = ground.vehicle_at(-50.0, 1)
    ground.vehicle_at(-50.0, 0)
    assert math.isfinite(halt_gap(ground, own))
