"""Targets: against analytic motion, against a slow second implementation, and under symmetries."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each
from tests.validator.driving import oracle_target

from branchdrive.driving.risk import risk_evidence
from branchdrive.driving.target import STEP_S, TARGETS, TRAJECTORY, Motion, Risk, Targets, scalar_targets, trajectory

TIME_S = np.arange(11) * 0.25
NAMES = [target.name for target in TARGETS]
NO_RISK = Risk(np.full((1, 10), np.nan), np.zeros((1, 10), bool), np.full((1, 10), np.nan), np.zeros((1, 10), bool))


def motion(x: Any, y: Any, yaw: Any, speed: Any) -> Motion:
    """One rollout."""
    return Motion(*(np.broadcast_to(np.asarray(values, float), 11)[None] for values in (x, y, yaw, speed)))


def named(targets: Targets) -> dict[str, float | None]:
    """Targets of the only rollout; ``None`` where unavailable."""
    (values,), (available,) = targets
    assert np.isnan(values[~available]).all()
    return {name: float(v) if there else None for name, v, there in zip(NAMES, values, available, strict=True)}


def test_a_step_is_a_quarter_of_a_second() -> None:
    assert STEP_S == 0.25


def test_constant_speed_is_perfectly_comfortable() -> None:
    heading = 0.7
    found = motion(3 + 8 * TIME_S * math.cos(heading), -2 + 8 * TIME_S * math.sin(heading), heading, 8)
    targets = named(scalar_targets(found, NO_RISK))
    assert targets["displacement_m"] == pytest.approx(20)
    assert [targets[name] for name in NAMES[3:]] == [0, 0, 0]
    (steps,), (available,) = trajectory(found)
    assert available.all()
    for column, expected in zip(TRAJECTORY, (8 * TIME_S[1:], 0, 0, 1, 8), strict=True):
        np.testing.assert_allclose(steps[:, TRAJECTORY.index(column)], expected, atol=1e-12)


def test_constant_acceleration_has_no_jerk() -> None:
    targets = named(scalar_targets(motion(4 * TIME_S + 1.5 * TIME_S**2, 0, 0, 4 + 3 * TIME_S), NO_RISK))
    assert targets["displacement_m"] == pytest.approx(4 * 2.5 + 1.5 * 2.5**2)
    assert targets["max_accel_mps2"] == pytest.approx(3)
    assert targets["mean_jerk_mps3"] == pytest.approx(0, abs=1e-12)


def test_braking_to_a_halt_jerks_once() -> None:
    # 5 m/s lost in the first second at 5 m/s2, then at rest: one step of 5 m/s2 among nine.
    targets = named(scalar_targets(motion(0, 0, 0, np.maximum(5 - 5 * TIME_S, 0)), NO_RISK))
    assert targets["max_accel_mps2"] == pytest.approx(5)
    assert targets["mean_jerk_mps3"] == pytest.approx(5 / 0.25 / 9)


def test_reversing_displaces_backwards() -> None:
    targets = named(scalar_targets(motion(-2 * TIME_S, 0, 0, -2), NO_RISK))
    assert targets["displacement_m"] == pytest.approx(-5)
    assert targets["max_accel_mps2"] == 0


@pytest.mark.parametrize("rate", [0.4, -0.4, 2.0])
def test_a_circle_has_the_acceleration_and_jerk_of_its_chords(rate: float) -> None:
    speed, start = 6.0, 3.0  # the heading passes pi on the way
    yaw = start + rate * TIME_S
    x = speed / rate * (np.sin(yaw) - math.sin(start))
    y = speed / rate * (math.cos(start) - np.cos(yaw))
    wrapped = (yaw + np.pi) % (2 * np.pi) - np.pi
    targets = named(scalar_targets(motion(x, y, wrapped, speed), NO_RISK))
    chord = 2 * math.sin(abs(rate) * 0.125) / 0.25  # difference of unit vectors one step apart
    assert targets["displacement_m"] == pytest.approx(speed / rate * math.sin(2.5 * rate))
    assert targets["max_yaw_rate_radps"] == pytest.approx(abs(rate))
    assert targets["max_accel_mps2"] == pytest.approx(speed * chord)
    assert targets["mean_jerk_mps3"] == pytest.approx(speed * chord**2)
    (steps,), _ = trajectory(motion(x, y, wrapped, speed))
    np.testing.assert_allclose(steps[:, 1], speed / rate * (1 - np.cos(rate * TIME_S[1:])), atol=1e-12)
    np.testing.assert_allclose(np.arctan2(steps[:, 2], steps[:, 3]), np.angle(np.exp(1j * rate * TIME_S[1:])))


def risk(ego_speed_mps: float, actors: list[tuple[float, float]]) -> Risk:
    """Risk of an ego that starts at 0 along x, among cars of 4 m at a start and a speed along x."""
    ticks = np.arange(11) * 5
    observed = {"tick": ticks, "x_m": ego_speed_mps * TIME_S, "y_m": np.zeros(11), "yaw_rad": np.zeros(11)}
    rows = [(tick, n, x + v * t, v) for n, (x, v) in enumerate(actors) for tick, t in zip(ticks, TIME_S, strict=True)]
    columns = np.array(rows, float).reshape(-1, 4).T
    flat = {name: np.zeros(len(rows)) for name in ("y_m", "yaw_rad", "vel_y_mps")}
    evidence = risk_evidence(
        {**observed, "speed_mps": np.full(11, ego_speed_mps)},
        {
            **flat,
            "tick": columns[0],
            "actor_id": columns[1],
            "x_m": columns[2],
            "vel_x_mps": columns[3],
            "length_m": np.full(len(rows), 4.0),
            "width_m": np.full(len(rows), 2.0),
            "actor_class": np.full(len(rows), "vehicle"),
        },
        ego_length_m=4.0,
        ego_width_m=2.0,
        route_x_m=np.array([0.0, 100.0]),
        route_y_m=np.zeros(2),
    )
    names = ("separation_m", "separation_available", "ttc_s", "ttc_available")
    return Risk(*(np.ma.getdata(evidence[name])[None, 1:] for name in names))


@each(
    ("ego_mps", "actors", "ttc_s", "separation_m"),
    [
        pytest.param(10, [(44, -5)], 40 / 15 - 2.5, 40 - 2.5 * 15, id="head-on"),
        pytest.param(10, [(44, 4)], 40 / 6 - 2.5, 40 - 2.5 * 6, id="catching up"),
        pytest.param(5, [(14, 9)], None, 10 + 0.25 * 4, id="receding"),
        pytest.param(10, [(14, 10)], None, 10, id="following at equal speed"),
        pytest.param(10, [(8, 0)], 0, 0, id="driving through"),
        pytest.param(0, [(3, 0)], 0, 0, id="standing in each other"),
        pytest.param(10, [], None, None, id="nobody there"),
        pytest.param(0, [(60, 0)], None, None, id="nobody in range"),
        pytest.param(20, [(80, 0)], 76 / 20 - 2.5, 76 - 2.5 * 20, id="in range later"),
        pytest.param(10, [(44, -5), (-14, 11)], 40 / 15 - 2.5, 40 - 2.5 * 15, id="the nearer of two"),
    ],
)
def test_risk_is_the_minimum_over_the_window(
    ego_mps: float, actors: list[tuple[float, float]], ttc_s: float | None, separation_m: float | None
) -> None:
    targets = named(scalar_targets(motion(ego_mps * TIME_S, 0, 0, ego_mps), risk(ego_mps, actors)))
    for name, expected in (("min_ttc_s", ttc_s), ("min_separation_m", separation_m)):
        assert targets[name] == (expected if expected is None else pytest.approx(expected, abs=1e-9))


def test_the_branch_observation_is_no_part_of_the_risk_window() -> None:
    # Nearest at t_b, where the gap is 1 m; the window begins a quarter of a second later.
    targets = named(scalar_targets(motion(0, 0, 0, 0), risk(0, [(5, 8)])))
    assert targets["min_separation_m"] == pytest.approx(3)


@pytest.mark.parametrize(
    ("frame", "lost"),
    [
        (0, {"displacement_m", "mean_jerk_mps3", "max_accel_mps2", "max_yaw_rate_radps"}),
        (4, {"mean_jerk_mps3", "max_accel_mps2", "max_yaw_rate_radps"}),
        (10, {"displacement_m", "mean_jerk_mps3", "max_accel_mps2", "max_yaw_rate_radps"}),
    ],
)
def test_a_missing_observation_costs_what_needs_it(frame: int, lost: set[str]) -> None:
    gone = np.where(np.arange(11) == frame, np.nan, 1.0)
    found = motion(gone * 4 * TIME_S, gone * 0, gone * 0, gone * 4)
    targets = named(scalar_targets(found, risk(4, [(30, 0)])))
    assert {name for name, value in targets.items() if value is None} == lost
    (steps,), (available,) = trajectory(found)
    expected = np.zeros(10, bool) if frame == 0 else np.arange(1, 11) != frame
    assert (available == expected).all()
    assert (np.isnan(steps).all(axis=1) == ~expected).all()


def test_evidence_that_is_no_number_is_no_evidence() -> None:
    near = risk(10, [(44, -5)])
    near.separation_m[0, 3], near.ttc_s[0, 3] = np.nan, np.inf
    targets = named(scalar_targets(motion(10 * TIME_S, 0, 0, 10), near))
    assert targets["min_separation_m"] is None
    assert targets["min_ttc_s"] == pytest.approx(40 / 15 - 2.5)


@pytest.mark.parametrize(
    ("found", "around", "message"),
    [
        (Motion(*[np.zeros((2, 10))] * 4), NO_RISK, r"`x_m` has shape \[2, 10\], not \[2, 11\]"),
        (Motion(*[np.zeros(11)] * 4), NO_RISK, r"`x_m` has shape \[11\], not \[11, 11\]"),
        (motion(0, 0, 0, 0)._replace(yaw_rad=np.zeros((2, 11))), NO_RISK, "`yaw_rad` has shape"),
        (motion(0, 0, 0, 0), NO_RISK._replace(ttc_s=np.zeros((1, 11))), r"`ttc_s` has shape \[1, 11\], not \[1, 10\]"),
        (Motion(*[np.zeros((2, 11))] * 4), NO_RISK, "motion has 2 rollouts and risk 1"),
    ],
)
def test_other_shapes_are_refused(found: Motion, around: Risk, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        scalar_targets(found, around)


def test_no_rollouts_have_no_targets() -> None:
    nothing = Motion(*[np.empty((0, 11))] * 4)
    assert scalar_targets(nothing, Risk(*[np.empty((0, 10))] * 4)).values.shape == (0, 6)
    assert trajectory(nothing).values.shape == (0, 10, 5)


places, angles, speeds = st.floats(-1e4, 1e4), st.floats(-np.pi, np.pi), st.floats(-60, 60)
drives = st.lists(st.tuples(places, places, angles, speeds), min_size=11, max_size=11)
evidence = st.lists(st.one_of(st.none(), st.floats(0, 100)), min_size=10, max_size=10)


def of_rows(drive: list[tuple[float, ...]]) -> Motion:
    return Motion(*(np.array(drive).T[:, None]))


def of_lists(separation: list[float | None], ttc: list[float | None]) -> Risk:
    sides = [
        side
        for values in (separation, ttc)
        for side in (np.array([[7.0 if v is None else v for v in values]]), np.array([[v is not None for v in values]]))
    ]
    return Risk(*sides)


@given(drives, evidence, evidence)
def test_targets_are_those_of_the_oracle(
    drive: list[tuple[float, float, float, float]], separation: list[float | None], ttc: list[float | None]
) -> None:
    found = named(scalar_targets(of_rows(drive), of_lists(separation, ttc)))
    for name, expected in zip(NAMES, oracle_target.scalars(drive, separation, ttc), strict=True):
        assert found[name] == (expected if expected is None else pytest.approx(expected, rel=1e-9, abs=1e-7)), name
    (steps,), _ = trajectory(of_rows(drive))
    np.testing.assert_allclose(steps, oracle_target.trajectory(drive), rtol=1e-9, atol=1e-7)


@given(drives, angles, places, places)
def test_a_rigid_motion_of_the_world_changes_no_target(
    drive: list[tuple[float, ...]], turn: float, shift_x: float, shift_y: float
) -> None:
    here = of_rows(drive)
    cos, sin = math.cos(turn), math.sin(turn)
    there = Motion(
        cos * here.x_m - sin * here.y_m + shift_x,
        sin * here.x_m + cos * here.y_m + shift_y,
        np.angle(np.exp(1j * (here.yaw_rad + turn))),
        here.speed_mps,
    )
    for before, after in zip(trajectory(here), trajectory(there), strict=True):
        np.testing.assert_allclose(after, before, atol=1e-7)
    before, after = (scalar_targets(side, NO_RISK).values[0, 2:] for side in (here, there))
    np.testing.assert_allclose(after, before, rtol=1e-9, atol=1e-7)


@given(drives)
def test_a_mirror_image_changes_no_scalar_and_turns_the_path_over(drive: list[tuple[float, ...]]) -> None:
    here = of_rows(drive)
    there = here._replace(y_m=-here.y_m, yaw_rad=-here.yaw_rad)
    np.testing.assert_array_equal(
        scalar_targets(there, NO_RISK).values[0, 2:], scalar_targets(here, NO_RISK).values[0, 2:]
    )
    mirrored = trajectory(here).values * [1, -1, -1, 1, 1]
    np.testing.assert_array_equal(trajectory(there).values, mirrored)


@given(st.lists(drives, min_size=1, max_size=4))
def test_rollouts_side_by_side_have_the_targets_they_have_alone(several: list[list[tuple[float, ...]]]) -> None:
    together = Motion(*np.array(several).transpose(2, 0, 1))
    many = Risk(*(np.repeat(field, len(several), axis=0) for field in NO_RISK))
    alone = [scalar_targets(of_rows(drive), NO_RISK).values[0] for drive in several]
    np.testing.assert_array_equal(scalar_targets(together, many).values, alone)
