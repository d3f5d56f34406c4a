"""Outcome noise: tolerances and spread of repeats, one-sided targets, repeats that lose, and differences beyond."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from branchdrive.benchmark.ranking.noise import OutcomeNoise, RepeatLosses, outcome_noise, selected_differences
from branchdrive.driving.target import Targets

Array = NDArray[np.float64]
NO_LOSSES = RepeatLosses(0, 0, 0, 0)


def targets(values: Array) -> Targets:
    return Targets(values, np.isfinite(values))


def noise_of(nominal: Array, repeats: Array, **options: float) -> OutcomeNoise:
    """Noise of repeats ``[groups, repeats, 6]``."""
    group_of = np.repeat(np.arange(len(nominal)), repeats.shape[1])
    return outcome_noise(
        targets(nominal), targets(repeats.reshape(-1, 6)), group_of, **{"tolerance_m": 0.25, **options}
    )


def test_the_tolerance_is_a_quantile_of_the_largest_move_of_a_group() -> None:
    nominal = np.full((20, 6), 3.0)
    repeats = np.repeat(nominal[:, None], 2, axis=1)
    repeats[:, 0, 1] += np.arange(20)
    repeats[:, 1, 1] -= np.arange(20) / 2
    repeats[:, 1, 3] -= np.arange(20) * 2
    noise = noise_of(nominal, repeats)
    # 95 % of 20 groups: place 18.05 of 0 .. 19, the higher neighbour.
    assert noise.tolerance.tolist() == [0, 19, 0, 38, 0, 0]
    assert noise_of(nominal, repeats, quantile=0.5).tolerance.tolist() == [0, 10, 0, 20, 0, 0]
    squares = (np.arange(20) ** 2).mean()
    assert noise.rms == pytest.approx([0, np.sqrt(squares * 5 / 8), 0, np.sqrt(squares * 2), 0, 0])
    assert noise.num_groups.tolist() == [20] * 6
    assert noise.num_one_sided.tolist() == [0] * 6


def test_a_target_on_one_side_alone_is_counted_and_left_out() -> None:
    nominal = np.full((3, 6), 3.0)
    repeats = np.full((3, 2, 6), 4.0)
    nominal[0, 0] = np.nan
    repeats[1, 1, 0] = np.nan
    nominal[:, 5] = np.nan
    noise = noise_of(nominal, repeats)
    assert noise.num_one_sided.tolist() == [2, 0, 0, 0, 0, 3]
    assert noise.num_groups.tolist() == [2, 3, 3, 3, 3, 0]
    np.testing.assert_array_equal(noise.tolerance, [1, 1, 1, 1, 1, np.nan])
    np.testing.assert_array_equal(noise.rms, [1, 1, 1, 1, 1, np.nan])


def test_a_group_whose_only_repeat_lacks_a_target_did_not_stand_still() -> None:
    nominal, repeats = np.zeros((20, 6)), np.ones((20, 6))
    repeats[:19, 1] = np.nan
    noise = outcome_noise(targets(nominal), targets(repeats), np.arange(20), tolerance_m=0.25, quantile=0.5)
    assert noise.num_groups.tolist() == [20, 1, 20, 20, 20, 20]
    assert noise.num_one_sided.tolist() == [0, 19, 0, 0, 0, 0]
    assert noise.tolerance.tolist() == noise.rms.tolist() == [1] * 6


def test_groups_may_have_any_number_of_repeats() -> None:
    repeats = np.array([[1.0] * 6, [2.0] * 6, [5.0] * 6])
    noise = outcome_noise(
        targets(np.zeros((4, 6))), targets(repeats), np.array([2, 2, 0]), tolerance_m=0.25, quantile=0.1
    )
    assert noise.num_groups.tolist() == [2] * 6
    assert noise.num_one_sided.tolist() == [0] * 6
    assert noise.tolerance.tolist() == [5] * 6  # the moves are 2 and 5: place 0.1 of 0 .. 1, the higher neighbour
    assert noise.rms == pytest.approx([np.sqrt((2.5 + 25) / 2)] * 6)


def test_repeats_that_lose_more_than_the_tolerance_are_counted() -> None:
    nominal = np.full((3, 6), 3.0)
    repeats = np.full((3, 2, 6), 3.0)
    repeats[0, :, 1] = [2.0, 2.7]
    repeats[1, :, 1] = [2.75, 5.0]  # a loss of the tolerance is none
    repeats[2, :, 1] = [np.nan, 2.5]
    assert noise_of(nominal, repeats, tolerance_m=0.25).losses == RepeatLosses(3, 2, 5, 3)
    assert noise_of(nominal, repeats, tolerance_m=0.5).losses == RepeatLosses(3, 1, 5, 1)
    both = noise_of(nominal, repeats, tolerance_m=0.25, further_m=[0.5])
    assert (both.losses, both.further_losses) == (RepeatLosses(3, 2, 5, 3), {0.5: RepeatLosses(3, 1, 5, 1)})


def test_a_difference_is_beyond_noise_above_the_tolerance_alone() -> None:
    outcomes = np.zeros((3, 2, 6))
    outcomes[:, 1, 1] = [0.5, -0.6, 0.7]
    outcomes[:, 1, 3] = [0.5, -0.6, 0.7]
    outcomes[0, 1, 0] = np.nan
    tolerance = np.array([0.1, 0.5, 0, 0.1, 0, np.nan])
    noise = OutcomeNoise(tolerance, tolerance, np.ones(6, np.int64), np.zeros(6, np.int64), NO_LOSSES)
    found = selected_differences(targets(outcomes), np.array([1, 1, 0]), noise, nominal=0)
    np.testing.assert_array_equal(found.difference[:, 1], [0.5, -0.6, 0])
    # Less separation is worse, less jerk is better.
    assert found.worse[:, 1].tolist() == [False, True, False]
    assert found.worse.sum(axis=0).tolist() == [0, 1, 0, 1, 0, 0]
    assert found.better.sum(axis=0).tolist() == [0, 0, 0, 1, 0, 0]
    assert found.num_compared.tolist() == [2, 3, 3, 3, 3, 3]


def test_the_standard_error_is_what_repetition_alone_gives() -> None:
    """Means over groups of which half take nominal itself, which differs from itself by nothing."""
    rng = np.random.default_rng(2)
    num_groups, sd = 50, 0.3
    rms = np.full(6, sd * np.sqrt(2))
    noise = OutcomeNoise(rms, rms, np.ones(6, np.int64), np.zeros(6, np.int64), NO_LOSSES)
    selection = np.arange(num_groups) % 2
    means, errors = [], []
    for _ in range(2000):
        outcomes = rng.normal(scale=sd, size=(num_groups, 2, 6))
        found = selected_differences(targets(outcomes), selection, noise, nominal=0)
        means.append(found.difference.mean(axis=0))
        errors.append(found.standard_error)
    np.testing.assert_array_equal(errors, np.broadcast_to(rms * np.sqrt(25) / 50, np.shape(errors)))
    np.testing.assert_allclose(np.std(means, axis=0), errors[0], rtol=0.06)


@given(st.integers(0, 1000), st.permutations(range(12)))
def test_the_order_of_groups_does_not_matter(seed: int, order: list[int]) -> None:
    rng = np.random.default_rng(seed)
    nominal, repeats = rng.normal(size=(12, 6)), rng.normal(size=(12, 3, 6))
    here = noise_of(nominal, repeats)
    there = noise_of(nominal[order], repeats[order][:, ::-1])
    assert here.tolerance.tolist() == there.tolerance.tolist()
    assert here.rms == pytest.approx(there.rms, rel=1e-14)
    assert here.losses == there.losses


def test_shapes_must_match() -> None:
    with pytest.raises(ValueError, match="do not match"):
        outcome_noise(targets(np.zeros((3, 6))), targets(np.zeros((3, 6))), np.arange(2), tolerance_m=0.25)
