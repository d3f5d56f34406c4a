"""Utilities: the scale, the direction of every target, profiles, ties, and groups that cannot be ranked."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each

from branchdrive.driving.target import TARGETS, Targets
from branchdrive.driving.utility import (
    PROFILES,
    WEIGHED,
    Profile,
    Scale,
    desirability,
    extreme_shares,
    fit_scale,
    predicted_utility,
    utility,
)

NAMES = [target.name for target in TARGETS]
UNIT = Scale(np.zeros(5), np.full(5, 10.0))


def targets(values: Any) -> Targets:
    found = np.asarray(values, float)
    return Targets(found, np.isfinite(found))


def test_quantiles_run_over_available_values_alone() -> None:
    values = np.tile(np.arange(101.0)[:, None], (1, 6))
    values[:, 1] = np.where(np.arange(101) < 51, values[:, 1], np.nan)
    scale = fit_scale(targets(values))
    assert scale.q05.tolist() == [2.5, 5, 5, 5, 5]
    assert scale.q95.tolist() == [47.5, 95, 95, 95, 95]


def test_quantiles_of_a_target_that_is_never_there_are_no_numbers() -> None:
    values = np.ones((4, 6))
    values[:, 1] = np.nan
    assert np.isnan(fit_scale(targets(values)).q05).tolist() == [True, False, False, False, False]


@each("name", WEIGHED)
@each(("value", "expected"), [(-5, 0), (0, 0), (2.5, 0.25), (10, 1), (99, 1), (math.nan, math.nan)])
def test_desirability_rises_with_progress_and_falls_with_discomfort(name: str, value: float, expected: float) -> None:
    row = np.zeros(6)
    row[NAMES.index(name)] = value
    wanted = 1 - expected if name in ("mean_jerk_mps3", "max_accel_mps2", "max_yaw_rate_radps") else expected
    found = desirability(targets(row), UNIT)[WEIGHED.index(name)]
    np.testing.assert_allclose(found, wanted, atol=1e-15)


def test_a_target_that_does_not_vary_decides_nothing() -> None:
    values = np.full((3, 6), 4.0)
    found = desirability(targets(values), fit_scale(targets(values)))
    assert (found == found[0]).all()
    assert np.isin(found, [0, 1]).all()


@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES)
def test_weights_of_a_profile_add_up_to_one(profile: Profile) -> None:
    assert profile.weights.sum() == pytest.approx(1)
    assert profile.weights[2:].tolist() == pytest.approx([profile.comfort / 3] * 3)


def test_there_are_four_profiles_and_one_of_the_near_range() -> None:
    assert list(PROFILES) == ["balanced", "safety", "progress", "comfort", "near_range"]
    assert [name for name, profile in PROFILES.items() if profile.near_m is not None] == ["near_range"]
    assert PROFILES["near_range"].weights.tolist() == PROFILES["safety"].weights.tolist()
    assert PROFILES["balanced"].weights == pytest.approx([1 / 3, 1 / 3, 1 / 9, 1 / 9, 1 / 9])


@pytest.mark.parametrize(
    ("profile", "expected"), [("balanced", 0.5 / 3 + 1 / 3), ("safety", 0.5), ("progress", 0.375), ("comfort", 0.625)]
)
def test_utility_is_the_weighted_mean(profile: str, expected: float) -> None:
    # Separation halfway, no progress, perfect comfort.
    assert utility(targets([0, 5, 0, 0, 0, 0]), UNIT, PROFILES[profile]) == pytest.approx(expected)


def speed_taken_off(gap_m: float, decel_mps2: float) -> float:
    """Closing speed that braking takes off within a gap, by small steps of time."""
    speed, travelled, dt_s = 0.0, 0.0, 1e-5
    while travelled < gap_m:  # the motion run backwards, from standstill
        travelled += speed * dt_s + decel_mps2 * dt_s**2 / 2
        speed += decel_mps2 * dt_s
    return speed


@pytest.mark.parametrize("gap_m", [0.02, 0.5, 1.0, 1.9])
def test_near_range_scores_a_gap_by_the_speed_that_braking_takes_off_in_it(gap_m: float) -> None:
    for decel_mps2 in (3.0, 8.0):
        share = speed_taken_off(gap_m, decel_mps2) / speed_taken_off(2.0, decel_mps2)
        found = desirability(targets([0, gap_m, 0, 0, 0, 0]), UNIT, near_m=2.0)
        assert found[0] == pytest.approx(share, abs=1e-3)
    assert found[1:].tolist() == desirability(targets([0, gap_m, 0, 0, 0, 0]), UNIT)[1:].tolist()


def test_near_range_knows_contact_and_nothing_beyond() -> None:
    gaps = targets([[0, gap_m, 0, 0, 0, 0] for gap_m in (-1.0, 0.0, 0.5, 2.0, 40.0, math.nan)])
    np.testing.assert_allclose(desirability(gaps, UNIT, near_m=2.0)[:, 0], [0, 0, 0.5, 1, 1, math.nan])


def test_near_range_makes_the_last_metre_worth_more_than_quantiles_do() -> None:
    touching, near, far = (
        utility(targets([0, gap_m, 0, 0, 0, 0]), UNIT, PROFILES["near_range"]) for gap_m in (0, 1, 9)
    )
    assert near - touching > far - near > 0
    ends = [utility(targets([0, gap_m, 0, 0, 0, 0]), UNIT, PROFILES["safety"]) for gap_m in (0, 1, 9)]
    assert ends[1] - ends[0] < (near - touching) / 5


@given(st.tuples(*[st.floats(0, 10)] * 4), st.tuples(*[st.floats(0, 10)] * 4), st.floats(2, 50))
def test_contact_is_never_better_than_the_whole_near_range(
    touching: tuple[float, ...], apart: tuple[float, ...], gap_m: float
) -> None:
    rows = targets([[0, 0, *touching], [0, gap_m, *apart]])
    contact, clear = utility(rows, UNIT, PROFILES["near_range"])
    assert contact <= clear + 1e-12


def test_time_to_collision_has_no_part_in_utility() -> None:
    rows = targets([[value, 5, 5, 5, 5, 5] for value in (0.1, 9.0, np.nan)])
    assert len(set(utility(rows, UNIT, PROFILES["balanced"]).tolist())) == 1


@pytest.mark.parametrize("name", WEIGHED)
def test_without_a_weighed_target_there_is_no_utility(name: str) -> None:
    row = np.full(6, 5.0)
    row[NAMES.index(name)] = np.nan
    assert np.isnan(utility(targets(row), UNIT, PROFILES["progress"]))


def test_best_and_worst_are_shared_by_ties() -> None:
    best, worst = extreme_shares(
        np.array([[0.2, 0.9, 0.9 - 5e-10, 0.1], [0.5, 0.5, 0.5, 0.5], [0.1, 0.2, 0.3, 0.3 - 1e-8]])
    )
    assert best.tolist() == [[0, 0.5, 0.5, 0], [0.25] * 4, [0, 0, 1, 0]]
    assert worst.tolist() == [[0, 0, 0, 1], [0.25] * 4, [1, 0, 0, 0]]


def test_a_group_with_an_unknown_utility_is_not_ranked() -> None:
    for shares in extreme_shares(np.array([[0.2, np.nan], [0.1, 0.3]])):
        assert np.isnan(shares).tolist() == [[True, True], [False, False]]


outcomes = st.lists(st.tuples(*[st.floats(-100, 100)] * 6), min_size=2, max_size=20)


@given(outcomes, st.sampled_from(sorted(PROFILES)))
def test_utility_lies_between_nothing_and_one(rows: list[tuple[float, ...]], profile: str) -> None:
    found = targets(rows)
    utilities = utility(found, fit_scale(found), PROFILES[profile])
    assert ((utilities >= 0) & (utilities <= 1 + 1e-12)).all()
    for shares in extreme_shares(utilities[None]):
        assert shares.sum() == pytest.approx(1)


@given(outcomes, st.integers(0, 4), st.floats(0, 50))
def test_more_of_what_is_wanted_is_never_worse(rows: list[tuple[float, ...]], column: int, more: float) -> None:
    found = targets(rows)
    scale = fit_scale(found)
    changed = found.values.copy()
    changed[0, NAMES.index(WEIGHED[column])] += more if column < 2 else -more
    before, after = (utility(side, scale, PROFILES["safety"])[0] for side in (found, targets(changed)))
    assert after >= before - 1e-12


@given(outcomes, st.floats(0.1, 10), st.floats(-50, 50))
def test_units_and_origins_do_not_matter(rows: list[tuple[float, ...]], factor: float, offset: float) -> None:
    here = targets(rows)
    scale = fit_scale(here)
    there = targets(here.values * factor + offset)
    # Quantiles closer than the floor mean a target that does not vary: leave those to their own test.
    if (np.minimum(1, factor) * (scale.q95 - scale.q05) > 1e-3).all():
        moved = utility(there, fit_scale(there), PROFILES["comfort"])
        np.testing.assert_allclose(moved, utility(here, scale, PROFILES["comfort"]), atol=1e-8)


def test_a_prediction_has_a_utility_for_every_candidate() -> None:
    rows = np.full((2, 3, 6), 5.0)
    rows[..., 2] = 10.0
    assert predicted_utility(rows, UNIT, PROFILES["progress"]) == pytest.approx(np.full((2, 3), 0.75))


def test_a_prediction_that_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^1 predicted values are not finite$"):
        predicted_utility(np.array([0, 1, np.nan, 0, 0, 0]), UNIT, PROFILES["progress"])
    with pytest.raises(ValueError, match="available nowhere in training"):
        predicted_utility(np.zeros(6), Scale(np.full(5, np.nan), np.ones(5)), PROFILES["progress"])
