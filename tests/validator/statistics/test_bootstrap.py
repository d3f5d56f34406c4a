"""Resamples: their law, that they are shared and fixed, and means over counted groups."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare
from tests.validator.statistics.samples import alone, pairs

from branchdrive.statistics import bootstrap
from branchdrive.statistics.bootstrap import counted_mean, design, ratio_of_sums, resampled_counts
from branchdrive.statistics.random_words import below, words
from branchdrive.statistics.rounding import sums


def test_a_design_holds_estimate_resamples_and_jackknife() -> None:
    found = design(alone(5), seed=1, num_resamples=40)
    estimate, resamples, jackknife, by_cluster = found.split(found[:])
    np.testing.assert_array_equal(estimate, np.ones(5))
    assert resamples.shape == (40, 5)
    assert (resamples.sum(axis=1) == 5).all()
    np.testing.assert_array_equal(jackknife, 1 - np.eye(5))
    assert by_cluster.shape == (40, 5)


def test_a_resample_of_clusters_takes_all_groups_of_each_that_it_draws() -> None:
    clusters = ["b", "a", "10", "b", "9", "b", "a"]
    names = ["10", "9", "a", "b"]  # as text
    drawn = below(words(3, "metric/bootstrap/clusters", 30, 4), 4)
    expected = np.zeros((30, 7))
    for row, places in zip(expected, drawn, strict=True):
        for place in places:
            for group, name in enumerate(clusters):
                row[group] += name == names[place]
    found = design(clusters, seed=3, num_resamples=30)
    np.testing.assert_array_equal(found.split(found[:])[3], expected)
    assert found.clusters.names == tuple(names)


def test_resamples_of_groups_do_not_depend_on_clusters() -> None:
    left, right = (design(clusters, seed=2, num_resamples=20) for clusters in (alone(8), pairs(8)))
    np.testing.assert_array_equal(left[:29], right[:29])
    assert (left[29:] != right[29:]).any()


def test_clusters_of_one_group_are_resampled_like_groups() -> None:
    found = design(alone(6), seed=0, num_resamples=20_000)
    by_group, by_cluster = found.split(found[:])[1::2]
    assert (by_group != by_cluster).any()
    for power in (1, 2):
        np.testing.assert_allclose((by_cluster**power).mean(axis=0), (by_group**power).mean(axis=0), rtol=0.05)


@given(st.lists(st.floats(-1e9, 1e9) | st.floats(-1e-9, 1e-9), min_size=1, max_size=12), st.integers(0, 9))
def test_products_with_a_design_are_those_with_all_its_rows(values: list[float], seed: int) -> None:
    found = design(pairs(len(values)), seed=seed, num_resamples=7)
    column = np.array(values)[:, None]
    np.testing.assert_array_equal(sums(found, column), sums(found[:], column))


@pytest.mark.parametrize("rows", [slice(0, 1), slice(3, 60, 7), slice(20, 37), slice(100, 200)])
def test_rows_of_a_design_are_those_of_all(rows: slice) -> None:
    found = design(pairs(15), seed=1, num_resamples=20)
    np.testing.assert_array_equal(found[rows], found[:][rows])


def test_a_design_of_many_groups_is_never_a_matrix_of_groups_by_groups() -> None:
    num_groups = 50_000  # squared, 20 GB
    found = design(alone(num_groups), seed=0, num_resamples=2)
    values = np.arange(num_groups, dtype=np.float64)[:, None]
    _, _, jackknife, _ = found.split(counted_mean(found, values))
    np.testing.assert_allclose(jackknife[:, 0], (values.sum() - values[:, 0]) / (num_groups - 1), rtol=1e-14)


def test_counts_of_another_stream_are_others() -> None:
    found = [resampled_counts(6, seed=1, stream=stream, num_resamples=30) for stream in ("metric/bootstrap", "other")]
    np.testing.assert_array_equal(found[0], design(alone(6), seed=1, num_resamples=30)[1:31])
    assert (found[0] != found[1]).any()
    assert (found[1].sum(axis=1) == 6).all()


def test_counts_take_a_byte_and_do_not_depend_on_how_many_are_drawn_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = resampled_counts(6, seed=1, stream="other", num_resamples=30)
    assert whole.dtype == np.uint8
    monkeypatch.setattr(bootstrap, "_MAX_WORDS", 50)
    np.testing.assert_array_equal(resampled_counts(6, seed=1, stream="other", num_resamples=30), whole)


def test_resamples_are_multinomial() -> None:
    counts = design(alone(4), seed=0, num_resamples=20_000)[1:20_001]
    assert chisquare(counts.sum(axis=0)).pvalue > 0.001
    expected = 20_000 * np.array([(3 / 4) ** 4, 4 * (1 / 4) * (3 / 4) ** 3])
    found = [np.count_nonzero(counts[:, 0] == k) for k in (0, 1)]
    np.testing.assert_allclose(found, expected, rtol=0.03)
    np.testing.assert_allclose(np.corrcoef(counts.T)[0, 1], -1 / 3, atol=0.03)


def test_a_resample_depends_on_seed_and_number_alone() -> None:
    few, many, other = (
        found.split(found[:])
        for found in (
            design(pairs(6), seed=3, num_resamples=9),
            design(pairs(6), seed=3),
            design(pairs(6), seed=4),
        )
    )
    for part in (1, 3):
        np.testing.assert_array_equal(few[part], many[part][:9])
        assert (many[part] != other[part]).any()


def test_no_group_is_no_sample() -> None:
    with pytest.raises(ValueError, match="at least one group"):
        design(alone(0), seed=1)


@given(st.lists(st.one_of(st.floats(-9, 9), st.just(np.nan)), min_size=1, max_size=7), st.integers(0, 99))
def test_a_counted_mean_is_that_of_repeated_groups(values: list[float], seed: int) -> None:
    counts = design(alone(len(values)), seed=seed, num_resamples=5)[:]
    found = counted_mean(counts, np.array(values)[:, None])
    for row, mean in zip(counts.astype(int), found[:, 0], strict=True):
        repeated = np.repeat(values, row)
        repeated = repeated[~np.isnan(repeated)]
        np.testing.assert_allclose(mean, repeated.mean() if repeated.size else np.nan, atol=1e-12)


def test_a_ratio_of_sums_is_no_mean_of_ratios() -> None:
    found = ratio_of_sums(np.array([[1.0, 1.0], [2.0, 0.0]]), np.array([[1.0], [9.0]]), np.array([[2.0], [3.0]]))
    np.testing.assert_array_equal(found, [[2.0], [0.5]])
