"""Resamples: their law, that they are shared and fixed, and means over counted groups."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare

from branchdrive.derive.metric.bootstrap import counted_mean, design, ratio_of_sums, resampled_counts


def test_a_design_holds_estimate_resamples_and_jackknife() -> None:
    found = design(5, seed=1, num_resamples=40)
    estimate, resamples, jackknife = found.split(found.counts)
    np.testing.assert_array_equal(estimate, np.ones(5))
    assert resamples.shape == (40, 5)
    assert (resamples.sum(axis=1) == 5).all()
    np.testing.assert_array_equal(jackknife, 1 - np.eye(5))


def test_counts_of_another_stream_are_others() -> None:
    found = [resampled_counts(6, seed=1, stream=stream, num_resamples=30) for stream in ("metric/bootstrap", "other")]
    np.testing.assert_array_equal(found[0], design(6, seed=1, num_resamples=30).counts[1:31])
    assert (found[0] != found[1]).any()
    assert (found[1].sum(axis=1) == 6).all()


def test_resamples_are_multinomial() -> None:
    counts = design(4, seed=0, num_resamples=20_000).counts[1:-4]
    assert chisquare(counts.sum(axis=0)).pvalue > 0.001
    expected = 20_000 * np.array([(3 / 4) ** 4, 4 * (1 / 4) * (3 / 4) ** 3])
    found = [np.count_nonzero(counts[:, 0] == k) for k in (0, 1)]
    np.testing.assert_allclose(found, expected, rtol=0.03)
    np.testing.assert_allclose(np.corrcoef(counts.T)[0, 1], -1 / 3, atol=0.03)


def test_a_resample_depends_on_seed_and_number_alone() -> None:
    np.testing.assert_array_equal(design(6, seed=3, num_resamples=9).counts[:8], design(6, seed=3).counts[:8])
    assert (design(6, seed=4).counts[1:2001] != design(6, seed=3).counts[1:2001]).any()


def test_no_group_is_no_sample() -> None:
    with pytest.raises(ValueError, match="at least one group"):
        design(0, seed=1)


@given(st.lists(st.one_of(st.floats(-9, 9), st.just(np.nan)), min_size=1, max_size=7), st.integers(0, 99))
def test_a_counted_mean_is_that_of_repeated_groups(values: list[float], seed: int) -> None:
    counts = design(len(values), seed=seed, num_resamples=5).counts
    found = counted_mean(counts, np.array(values)[:, None])
    for row, mean in zip(counts.astype(int), found[:, 0], strict=True):
        repeated = np.repeat(values, row)
        repeated = repeated[~np.isnan(repeated)]
        np.testing.assert_allclose(mean, repeated.mean() if repeated.size else np.nan, atol=1e-12)


def test_a_ratio_of_sums_is_no_mean_of_ratios() -> None:
    found = ratio_of_sums(np.array([[1.0, 1.0], [2.0, 0.0]]), np.array([[1.0], [9.0]]), np.array([[2.0], [3.0]]))
    np.testing.assert_array_equal(found, [[2.0], [0.5]])
