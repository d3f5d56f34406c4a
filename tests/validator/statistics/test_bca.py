"""Intervals against scipy on the same resamples, and where there is none."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import bootstrap
from tests.validator.statistics.samples import alone, pairs, same

from branchdrive.statistics import bca
from branchdrive.statistics.bca import LEAST_UNITS, LEVELS, Intervals, intervals, ratio_intervals
from branchdrive.statistics.bootstrap import Design, counted_mean, design, ratio_of_sums
from branchdrive.statistics.random_words import below, words


def of_values(values: np.ndarray, resampling: Design) -> Intervals:
    """Intervals of the mean of values ``[N, K]``."""
    found = resampling.split(counted_mean(resampling, values))
    there = ~np.isnan(values)
    return intervals(*found, there.sum(axis=0), resampling.clusters.num_there(there))


@pytest.mark.parametrize("seed", range(4))
def test_both_intervals_are_those_of_scipy(seed: int) -> None:
    values = np.random.default_rng(seed).lognormal(sigma=1.2, size=31)
    resampling = design(alone(31), seed=seed, num_resamples=500)
    ends = of_values(values[:, None], resampling)
    means = resampling[1:501] @ values / 31
    for method, low, high in [
        ("percentile", ends.low, ends.high),
        ("BCa", ends.bca_low, ends.bca_high),
    ]:
        found = bootstrap(
            (values,),
            np.mean,
            n_resamples=0,
            method=method,
            bootstrap_result=SimpleNamespace(bootstrap_distribution=means),
        ).confidence_interval
        same([low[0], high[0]], [found.low, found.high])


@pytest.mark.parametrize("cells", [1, 2000, 1 << 21])
def test_intervals_of_many_ratios_are_those_of_each(cells: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    above, under = rng.normal(size=(31, 5)), rng.uniform(0.5, 1.5, (31, 5))
    there = rng.uniform(size=(31, 5)) > 0.2
    above, under = above * there, under * there
    resampling = design(alone(31), seed=1, num_resamples=300)
    monkeypatch.setattr(bca, "_CELLS_AT_ONCE", cells)
    ratios, ends = ratio_intervals(resampling, above, under, there)
    for k in range(5):
        one = slice(k, k + 1)
        parts = resampling.split(ratio_of_sums(resampling, above[:, one], under[:, one]))
        own = intervals(*parts, there[:, one].sum(axis=0), resampling.clusters.num_there(there[:, one]))
        assert ratios[k] == parts[0][0]
        same([field[k] for field in ends], [field[0] for field in own])


def test_a_root_mean_square_has_the_intervals_of_scipy() -> None:
    squares = np.random.default_rng(5).gamma(1.0, size=25)
    resampling = design(alone(25), seed=8, num_resamples=400)
    found = resampling.split(np.sqrt(counted_mean(resampling, squares[:, None])))
    ends = intervals(*found, np.array([25]), np.array([25]))
    expected = bootstrap(
        (squares,),
        lambda sample, axis: np.sqrt(np.mean(sample, axis=axis)),
        n_resamples=0,
        method="BCa",
        bootstrap_result=SimpleNamespace(bootstrap_distribution=found[1][:, 0]),
    ).confidence_interval
    same([ends.bca_low[0], ends.bca_high[0]], [expected.low, expected.high])


def test_two_thousand_fresh_resamples_of_scipy_agree_to_sampling_error() -> None:
    values = np.random.default_rng(0).normal(size=60)
    ends = of_values(values[:, None], design(alone(60), seed=0))
    expected = bootstrap((values,), np.mean, n_resamples=2000, method="percentile", rng=1).confidence_interval
    np.testing.assert_allclose([ends.low[0], ends.high[0]], [expected.low, expected.high], atol=0.03)


def test_the_bootstrap_covers_a_normal_mean() -> None:
    rng = np.random.default_rng(2)
    ends = of_values(rng.normal(size=(40, 300)), design(alone(40), seed=1))
    assert 0.90 < np.mean((ends.low <= 0) & (ends.high >= 0)) < 0.98
    assert 0.90 < np.mean((ends.bca_low <= 0) & (ends.bca_high >= 0)) < 0.98


def test_resamples_of_clusters_cover_a_mean_of_correlated_groups_and_those_of_groups_do_not() -> None:
    """Values with an intra-cluster correlation of 0.8, 40 clusters of two groups."""
    rng = np.random.default_rng(0)
    values = np.sqrt(0.8) * np.repeat(rng.normal(size=(40, 300)), 2, axis=0) + np.sqrt(0.2) * rng.normal(size=(80, 300))
    ends = of_values(values, design(pairs(80), seed=1, num_resamples=500))
    assert 0.90 < np.mean((ends.cluster_low <= 0) & (ends.cluster_high >= 0)) < 0.98
    assert np.mean((ends.low <= 0) & (ends.high >= 0)) < 0.88


def test_the_interval_by_clusters_is_that_of_their_repeated_groups() -> None:
    values = np.random.default_rng(4).gamma(1.0, size=7)
    names = ["b", "a", "c", "b", "b", "c", "d"]
    drawn = below(words(6, "metric/bootstrap/clusters", 90, 4), 4)
    means = [np.mean([values[g] for c in row for g in range(7) if names[g] == "abcd"[c]]) for row in drawn.tolist()]
    ends = of_values(values[:, None], design(names, seed=6, num_resamples=90))
    same([ends.cluster_low[0], ends.cluster_high[0]], np.quantile(means, [0.025, 0.975]))


def test_a_single_cluster_has_no_interval() -> None:
    values = np.full((6, 2), np.nan)
    values[:, 0], values[:2, 1] = np.arange(6), [1.0, 2.0]
    ends = of_values(values, design(["a", "a", "b", "b", "b", "b"], seed=0, num_resamples=50))
    assert np.isfinite([ends.low[0], ends.cluster_low[0], ends.low[1]]).all()
    assert np.isnan([ends.cluster_low[1], ends.cluster_high[1]]).all()
    assert ends.cluster_num_undefined[1] > 0


def test_shifting_and_scaling_values_shifts_and_scales_the_ends() -> None:
    values = np.random.default_rng(1).gamma(1.0, size=(20, 1))
    resampling = design(alone(20), seed=1, num_resamples=300)
    plain, moved = of_values(values, resampling), of_values(3 * values + 2, resampling)
    for left, right in zip([*plain[:4], *plain[5:7]], [*moved[:4], *moved[5:7]], strict=True):
        same(3 * left + 2, right)


def test_equal_values_have_an_interval_of_no_width() -> None:
    ends = of_values(np.full((12, 1), 0.5), design(alone(12), seed=0, num_resamples=100))
    assert [float(end[0]) for end in ends[:4]] == [0.5] * 4


def test_resamples_without_the_metric_are_left_out_and_counted() -> None:
    values = np.full((6, 1), np.nan)
    values[:2, 0] = [1.0, 3.0]
    resampling = design(alone(6), seed=0, num_resamples=400)
    ends = of_values(values, resampling)
    without = int((resampling[1:401][:, :2].sum(axis=1) == 0).sum())
    assert without > 0
    assert ends.num_undefined[0] == without
    assert (float(ends.low[0]), float(ends.high[0])) == (1.0, 3.0)


@pytest.mark.parametrize("there", [0, 1])
def test_fewer_than_two_groups_have_no_interval(there: int) -> None:
    values = np.full((4, 1), np.nan)
    values[:there] = 1.0
    ends = of_values(values, design(alone(4), seed=0, num_resamples=50))
    assert np.isnan([end[0] for end in ends[:4]]).all()


def test_an_estimate_outside_all_resamples_has_no_bca() -> None:
    resamples = np.arange(5.0)[:, None]
    ends = intervals(np.array([9.0]), resamples, np.arange(3.0)[:, None], resamples, np.array([3]), np.array([3]))
    assert np.isnan([ends.bca_low[0], ends.bca_high[0]]).all()
    same([ends.low[0], ends.high[0]], [0.1, 3.9])


def test_fewer_units_than_the_least_are_all_on_one_side_too_often() -> None:
    for num_units in (LEAST_UNITS - 1, LEAST_UNITS):
        signs = np.array([*product((-1.0, 1.0), repeat=num_units)])
        on_one_side = float((np.abs(signs.mean(axis=1)) == 1).mean())
        assert (on_one_side <= 1 - (LEVELS[1] - LEVELS[0])) == (num_units == LEAST_UNITS)
