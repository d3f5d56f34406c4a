"""Leads of recorded rates on positions and headings, against motion that is known at every time."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.synthetic import Tables
from tests.validator.raw.motion.changed import TABLES, changed, view_of

from branchdrive.contract.timing import TICK_S
from branchdrive.raw.motion.calibration import calibration, calibration_between_contacts
from branchdrive.raw.motion.clock import MIN_CHANGE_MPS
from branchdrive.raw.motion.quantity import wrong_of_one

Array = NDArray[np.float64]

OBSERVATION_S = 0.25
SWING_RADPS = 1.5
"""How fast speeds and yaw rates swing here: one period is seventeen observations."""

MEAN_MPS, SWING_MPS, TURN_RADPS = 10.0, 3.0, 0.4
TIME_S = TABLES["observations"]["tick"].to_numpy() * TICK_S


def _speed(time_s: Array) -> Array:
    return MEAN_MPS + SWING_MPS * np.cos(SWING_RADPS * time_s)


def _rate(time_s: Array) -> Array:
    return TURN_RADPS * np.cos(SWING_RADPS * time_s)


def _yaw(time_s: Array) -> Array:
    return TURN_RADPS / SWING_RADPS * np.sin(SWING_RADPS * time_s)


def _way(direction: np.ufunc) -> Array:
    """Position at every observation, along one axis, by the midpoint rule."""
    per_tick = 50
    middle = (np.arange(per_tick * (round(TIME_S.max() / TICK_S) + 1)) + 0.5) * TICK_S / per_tick
    way = np.append(0.0, np.cumsum(_speed(middle) * direction(_yaw(middle)) * TICK_S / per_tick))
    return way[np.round(TIME_S / TICK_S).astype(int) * per_tick]


RATES = {
    "speed_mps": _speed,
    "yaw_rate_radps": _rate,
    "accel_longitudinal_mps2": lambda time_s: -SWING_MPS * SWING_RADPS * np.sin(SWING_RADPS * time_s),
    "accel_lateral_mps2": lambda time_s: _speed(time_s) * _rate(time_s),
}
"""Recorded rates of an ego that drives in a serpentine, faster and slower in turn."""


def _serpentine(column: str, late: float, unit: float = 1.0) -> Tables:
    """Motion with a column of so many observations before, in some unit."""
    values = {name: rate(TIME_S - (late * OBSERVATION_S if name == column else 0.0)) for name, rate in RATES.items()}
    values[column] = unit * values[column]
    return changed("observations", x_m=_way(np.cos), y_m=_way(np.sin), yaw_rad=_yaw(TIME_S), **values)


def _leads(tables: Tables, name: str) -> Array:
    values = calibration(view_of(tables))[name]
    assert np.isfinite(values).sum() > 20
    return values[np.isfinite(values)]


@pytest.mark.parametrize("late", [-1.0, -0.5, 0.0, 0.5, 1.0])
@pytest.mark.parametrize(("column", "name"), [("speed_mps", "speed_lead"), ("yaw_rate_radps", "yaw_rate_lead")])
def test_states_lead_by_as_much_as_they_are_early(column: str, name: str, late: float) -> None:
    np.testing.assert_allclose(_leads(_serpentine(column, late), name), -late, atol=0.06)


@pytest.mark.parametrize(
    ("column", "unit", "name", "expected"),
    [
        ("speed_mps", 3.6, "speed_lead", 0.0),
        ("accel_longitudinal_mps2", 1 / 9.81, "longitudinal_lead", 1.0),
        ("accel_lateral_mps2", -1.0, "lateral_lead", 0.5),
    ],
)
def test_another_unit_or_sign_is_no_lead(column: str, unit: float, name: str, expected: float) -> None:
    np.testing.assert_allclose(_leads(_serpentine(column, 0.0, unit), name), expected, atol=0.06)


@pytest.mark.parametrize(("unit", "is_judged"), [(180.0 / np.pi, False), (-1.0, False), (0.2, False), (3.0, True)])
def test_yaw_rates_whose_value_is_right_of_no_attempt_have_no_lead_and_give_none(unit: float, is_judged: bool) -> None:
    tables = _serpentine("yaw_rate_radps", 0.0, unit)
    np.testing.assert_allclose(_leads(tables, "yaw_rate"), unit, rtol=0.1)
    for found in (calibration(view_of(tables)), calibration_between_contacts(view_of(tables))):
        for name in ("yaw_rate_lead", "lateral_lead"):
            assert np.isfinite(found[name]).any() == is_judged


def test_gentle_turns_whose_yaw_rates_have_no_value_tell_the_time_of_accelerations() -> None:
    number, speed = np.round(TIME_S / OBSERVATION_S).astype(int), np.full(len(TIME_S), 14.5)
    of_step = 0.0495 * np.where(np.arange(number.max() + 1) // 3 % 2, 1.0, -1.0)
    turned = np.append(0.0, np.cumsum(of_step * OBSERVATION_S))
    aside = np.append(0.0, np.cumsum(14.5 * np.sin((turned[1:] + turned[:-1]) / 2) * OBSERVATION_S))
    places = {"x_m": speed * TIME_S, "y_m": aside[number], "yaw_rad": turned[number], "speed_mps": speed}
    rate = of_step[np.maximum(number - 1, 0)]
    rates = {"yaw_rate_radps": rate, "accel_lateral_mps2": speed * rate}
    found = calibration(view_of(changed("observations", **places, **rates)))
    assert np.isnan(found["yaw_rate"]).all()
    assert np.isnan(found["yaw_rate_lead"]).all()
    assert np.isfinite(found["lateral_lead"]).any()


@pytest.mark.parametrize(("late", "expected"), [(0.0, 1.0), (1.0, 0.0)])
def test_longitudinal_accelerations_are_of_the_end_of_their_step(late: float, expected: float) -> None:
    tables = _serpentine("accel_longitudinal_mps2", late)
    np.testing.assert_allclose(_leads(tables, "longitudinal_lead"), expected, atol=0.06)


@pytest.mark.parametrize(("late", "expected"), [(0.0, 0.5), (1.0, -0.5)])
def test_lateral_accelerations_are_of_their_own_speed_and_yaw_rate(late: float, expected: float) -> None:
    tables = _serpentine("accel_lateral_mps2", late)
    np.testing.assert_allclose(_leads(tables, "lateral_lead"), expected, atol=0.06)


def test_slow_and_fast_vehicles_say_nothing_of_the_time_of_lateral_accelerations() -> None:
    for speed_mps in (7.9, 15.1):
        tables = changed("observations", speed_mps=np.full(len(TIME_S), speed_mps), yaw_rate_radps=_rate(TIME_S))
        assert np.isnan(calibration(view_of(tables))["lateral_lead"]).all()


@pytest.mark.parametrize("is_of_the_end", [False, True])
def test_speeds_that_jump_at_observations_lead_by_a_half_at_most(is_of_the_end: bool) -> None:
    """Recorded before the jump, or after it."""
    number = np.round(TIME_S / OBSERVATION_S).astype(int)
    of_step = MEAN_MPS + np.array([0.0, 1.0, 3.0, 2.0])[np.arange(number.max() + 2) // 3 % 4]
    way = np.append(0.0, np.cumsum(of_step * OBSERVATION_S))
    speed = of_step[number if is_of_the_end else np.maximum(number - 1, 0)]
    tables = changed("observations", x_m=way[number], y_m=0 * TIME_S, yaw_rad=0 * TIME_S, speed_mps=speed)
    np.testing.assert_allclose(_leads(tables, "speed_lead"), 0.5 if is_of_the_end else -0.5, atol=0.03)


def _riding(late: float, swing_mps: float = 2.0) -> Tables:
    """Vehicles and cycles that ride to and fro of a straight way, with velocities of so many observations before."""
    rows = TABLES["actors"]
    time_s = rows["tick"].to_numpy() * TICK_S
    swing = swing_mps * np.cos(SWING_RADPS * (time_s - late * OBSERVATION_S))
    ahead = MEAN_MPS * time_s + swing_mps / SWING_RADPS * np.sin(SWING_RADPS * time_s)
    return changed(
        "actors",
        x_m=0.6 * ahead,
        y_m=0.8 * ahead,
        vel_x_mps=0.6 * (MEAN_MPS + swing),
        vel_y_mps=0.8 * (MEAN_MPS + swing),
    )


@pytest.mark.parametrize("late", [-1.0, 0.0, 1.0])
def test_velocities_lead_by_as_much_as_they_are_early(late: float) -> None:
    tables = _riding(late)
    np.testing.assert_allclose(_leads(tables, "actor_lead"), -late, atol=0.06)
    parts = calibration_between_contacts(view_of(tables))["actor_lead"]
    wrong = wrong_of_one("actor_lead", parts)
    assert wrong.any(axis=1).tolist() == [late != 0, False, False]


def test_velocities_that_hardly_change_say_nothing_of_time() -> None:
    """A swing whose largest change from one quarter second to the next stays below what counts."""
    swing_mps = 0.99 * MIN_CHANGE_MPS / (2 * np.sin(SWING_RADPS * OBSERVATION_S / 2))
    assert np.isnan(calibration(view_of(_riding(1.0, swing_mps)))["actor_lead"]).all()
