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


def test_there_are_four_profiles() -> None:
    assert list(PROFILES) == ["balanced", "safety", "progress", "comfort"]
    assert PROFILES["balanced"].weights == pytest.approx([1 / 3, 1 / 3, 1 / 9, 1 / 9, 1 / 9])


@pytest.mark.parametrize(
    ("profile", "expected"), [("balanced", 0.5 / 3 + 1 / 3), ("safety", 0.5), ("progress", 0.375), ("comfort", 0.625)]
)
def test_utility_is_the_weighted_mean(profile: str, expected: float) -> None:
    # Separation halfway, no progress, perfect comfort.
    assert utility(targets([0, 5, 0, 0, 0, 0]), UNIT, PROFILES[profile]) == pytest.approx(expected)


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
