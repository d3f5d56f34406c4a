"""Clusters: their order, sums over them, and the correlation within them against scipy's analysis of variance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import f_oneway
from tests.validator.statistics.samples import alone, pairs

from branchdrive.statistics.cluster import Clusters, intra_cluster_correlation


def correlation(values: list[float], names: list[str]) -> float:
    return float(intra_cluster_correlation(np.array(values)[:, None], Clusters.of(names))[0])


def test_clusters_are_in_the_order_of_their_names_as_text() -> None:
    found = Clusters.of(["9", "10", "9", "b"])
    assert found.names == ("10", "9", "b")
    np.testing.assert_array_equal(found.of_group, [1, 0, 1, 2])


def test_sums_and_counts_are_over_the_groups_of_each_cluster() -> None:
    found = Clusters.of(["b", "a", "b"])
    np.testing.assert_array_equal(found.sums(np.array([[1.0, 10.0], [2.0, 20.0], [4.0, 40.0]])), [[2, 20], [5, 50]])
    np.testing.assert_array_equal(found.num_there(np.array([[True, True], [True, False], [False, True]])), [2, 1])


@pytest.mark.parametrize("seed", range(3))
def test_the_correlation_follows_from_the_f_statistic(seed: int) -> None:
    rng = np.random.default_rng(seed)
    names = [f"c{i}" for i in rng.integers(0, 6, 25)]
    values = rng.normal(size=25) + np.array([int(name[1:]) for name in names]) * seed
    parts = [values[np.array(names) == name] for name in sorted(set(names))]
    sizes = np.array([len(part) for part in parts])
    f = f_oneway(*parts).statistic
    size = (25 - (sizes**2).sum() / 25) / (len(parts) - 1)
    assert correlation(values.tolist(), names) == pytest.approx((f - 1) / (f + size - 1))


def test_groups_without_a_difference_are_as_if_they_were_not() -> None:
    values, names = [1.0, 1.5, np.nan, 4.0, 3.0, np.nan], ["a", "a", "a", "b", "b", "c"]
    assert correlation(values, names) == pytest.approx(correlation([1.0, 1.5, 4.0, 3.0], ["a", "a", "b", "b"]))


def test_groups_that_agree_within_clusters_are_perfectly_correlated() -> None:
    assert correlation([1.0, 1.0, 5.0, 5.0, -2.0, -2.0], pairs(6)) == pytest.approx(1.0)


def test_a_simulated_correlation_is_found() -> None:
    rng = np.random.default_rng(1)
    d = np.sqrt(0.8) * np.repeat(rng.normal(size=2000), 2) + np.sqrt(0.2) * rng.normal(size=4000)
    assert correlation(d.tolist(), pairs(4000)) == pytest.approx(0.8, abs=0.02)
    assert correlation(d.tolist(), [f"c{i % 2000}" for i in range(4000)]) == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize(
    ("values", "names"),
    [
        ([1.0, 2.0, 3.0], ["a"] * 3),
        ([1.0, 2.0, 3.0], alone(3)),
        ([0.1, 0.1, 0.1, 0.1], pairs(4)),
        ([0.0, 0.0, 0.0, 0.0], pairs(4)),
        ([np.nan, np.nan], ["a", "a"]),
    ],
)
def test_a_correlation_that_is_not_defined_is_nan(values: list[float], names: list[str]) -> None:
    assert np.isnan(correlation(values, names))
