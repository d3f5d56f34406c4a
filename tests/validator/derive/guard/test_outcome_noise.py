"""Outcome noise: tolerances from repeats, one-sided targets, and differences beyond them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from branchdrive.derive.guard.outcome_noise import OutcomeNoise, outcome_noise, selected_differences
from branchdrive.derive.target import Targets

Array = NDArray[np.float64]


def targets(values: Array) -> Targets:
    return Targets(values, np.isfinite(values))


def test_the_tolerance_is_a_quantile_of_the_largest_move_of_a_group() -> None:
    nominal = np.full((20, 6), 3.0)
    repeats = np.repeat(nominal[:, None], 2, axis=1)
    repeats[:, 0, 1] += np.arange(20)
    repeats[:, 1, 1] -= np.arange(20) / 2
    repeats[:, 1, 3] -= np.arange(20) * 2
    noise = outcome_noise(targets(nominal), targets(repeats))
    # 95 % of 20 groups: place 18.05 of 0 .. 19, the higher neighbour.
    assert noise.tolerance.tolist() == [0, 19, 0, 38, 0, 0]
    assert outcome_noise(targets(nominal), targets(repeats), quantile=0.5).tolerance.tolist() == [0, 10, 0, 20, 0, 0]
    assert noise.num_groups.tolist() == [20] * 6
    assert noise.num_one_sided.tolist() == [0] * 6


def test_a_target_on_one_side_alone_is_counted_and_left_out() -> None:
    nominal = np.full((3, 6), 3.0)
    repeats = np.full((3, 2, 6), 4.0)
    nominal[0, 0] = np.nan
    repeats[1, 1, 0] = np.nan
    nominal[:, 5] = np.nan
    noise = outcome_noise(targets(nominal), targets(repeats))
    assert noise.num_one_sided.tolist() == [2, 0, 0, 0, 0, 3]
    assert noise.num_groups.tolist() == [2, 3, 3, 3, 3, 0]
    np.testing.assert_array_equal(noise.tolerance, [1, 1, 1, 1, 1, np.nan])


def test_a_difference_is_beyond_noise_above_the_tolerance_alone() -> None:
    outcomes = np.zeros((3, 2, 6))
    outcomes[:, 1, 1] = [0.5, -0.6, 0.7]
    outcomes[0, 1, 0] = np.nan
    noise = OutcomeNoise(np.array([0.1, 0.5, 0, 0, 0, np.nan]), np.ones(6, np.int64), np.zeros(6, np.int64))
    found = selected_differences(targets(outcomes), np.array([1, 1, 0]), noise, nominal=0)
    np.testing.assert_array_equal(found.difference[:, 1], [0.5, -0.6, 0])
    assert found.beyond[:, 1].tolist() == [False, True, False]
    assert found.num_beyond.tolist() == [0, 1, 0, 0, 0, 0]
    assert found.num_compared.tolist() == [2, 3, 3, 3, 3, 3]


@given(st.integers(0, 1000), st.permutations(range(12)))
def test_the_order_of_groups_does_not_matter(seed: int, order: list[int]) -> None:
    rng = np.random.default_rng(seed)
    nominal, repeats = rng.normal(size=(12, 6)), rng.normal(size=(12, 3, 6))
    here = outcome_noise(targets(nominal), targets(repeats))
    there = outcome_noise(targets(nominal[order]), targets(repeats[order][:, ::-1]))
    assert here.tolerance.tolist() == there.tolerance.tolist()


def test_shapes_must_match() -> None:
    with pytest.raises(ValueError, match="do not match"):
        outcome_noise(targets(np.zeros((2, 6))), targets(np.zeros((3, 1, 6))))
    with pytest.raises(ValueError, match="do not match"):
        outcome_noise(targets(np.zeros((2, 6))), targets(np.zeros((2, 6))))
