"""Paired tests against scipy, exact enumeration and theory."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import permutation_test, ttest_1samp
from tests.validator.statistics.samples import alone, pairs

from branchdrive.statistics.bootstrap import design
from branchdrive.statistics.cluster import Clusters
from branchdrive.statistics.sign_flip import CLUSTER_STREAM, draw_signs, p_text, sign_flip, studentised_p

DIFFERENCES = st.lists(st.floats(-4, 4, width=16), min_size=1, max_size=8)


def all_signs(num_groups: int) -> np.ndarray:
    return np.array(list(product([1.0, -1.0], repeat=num_groups)))


@given(DIFFERENCES.filter(lambda d: len(d) > 1))
def test_all_sign_flips_give_the_exact_test_of_scipy(differences: list[float]) -> None:
    d = np.array(differences)
    exact = permutation_test((d,), np.mean, permutation_type="samples", n_resamples=np.inf, vectorized=True).pvalue
    num = 2 ** len(d)
    found = sign_flip(d[:, None], all_signs(len(d))).p[0]
    assert found * (num + 1) - 1 == pytest.approx(exact * num)


def test_drawn_flips_agree_with_scipy_to_sampling_error() -> None:
    d = np.random.default_rng(3).normal(0.2, 1, 50)
    expected = permutation_test((d,), np.mean, permutation_type="samples", n_resamples=10_000, rng=1).pvalue
    assert 0.05 < expected < 0.5
    assert sign_flip(d[:, None], draw_signs(50, seed=0)).p[0] == pytest.approx(expected, abs=0.02)


def test_signs_are_fair_and_independent() -> None:
    signs = draw_signs(70, seed=5)
    assert (signs.shape, signs.dtype) == ((10_000, 70), np.int8)
    assert set(np.unique(signs).tolist()) == {-1.0, 1.0}
    assert np.abs(signs.mean(axis=0)).max() < 0.05
    assert np.abs(np.corrcoef(signs.T) - np.eye(70)).max() < 0.06


def test_a_flip_depends_on_seed_and_number_alone() -> None:
    np.testing.assert_array_equal(draw_signs(70, seed=5, num_flips=20), draw_signs(70, seed=5)[:20])
    assert (draw_signs(70, seed=6, num_flips=20) != draw_signs(70, seed=5, num_flips=20)).any()


@given(DIFFERENCES, st.integers(-3, 3), st.randoms(use_true_random=False))
def test_sign_scale_and_order_of_groups_change_no_p(differences: list[float], power: int, random: object) -> None:
    d = np.array(differences)[:, None]
    signs = draw_signs(len(d), seed=1, num_flips=200)
    order = list(range(len(d)))
    random.shuffle(order)  # type: ignore[attr-defined]
    expected = sign_flip(d, signs)
    for other in (
        sign_flip(-d, signs),
        sign_flip(d * 2.0**power, signs),
        sign_flip(d[order], signs[:, order]),
    ):
        np.testing.assert_array_equal(other.p, expected.p)


def test_the_smallest_p_is_a_bound() -> None:
    found = sign_flip(np.ones((107, 1)), draw_signs(107, seed=0))
    assert found.p[0] == 1 / 10_001
    assert found.is_smallest[0]
    assert p_text(found.p[0], True) == "<= 0.0001"
    assert p_text(9 * found.p[0], True) == "<= 0.0009"
    assert p_text(0.1234, False) == "0.12"


def test_no_difference_is_never_significant() -> None:
    signs = draw_signs(5, seed=0, num_flips=100)
    counts = design(alone(5), seed=0, num_resamples=50)[1:51]
    columns = np.stack([np.zeros(5), np.full(5, np.nan)], axis=1)
    found = sign_flip(columns, signs)
    np.testing.assert_array_equal(found.p, [1.0, 1.0])
    np.testing.assert_array_equal(found.mean, [0.0, np.nan])
    np.testing.assert_array_equal(found.num_units, [5, 0])
    np.testing.assert_array_equal(studentised_p(columns, counts), [1.0, 1.0])


def test_a_single_group_is_never_significant() -> None:
    assert sign_flip(np.array([[3.0]]), draw_signs(1, seed=0)).p[0] == 1.0
    assert studentised_p(np.array([[3.0]]), design(alone(1), seed=0, num_resamples=20)[1:21])[0] == 1.0


def test_groups_without_a_difference_are_as_if_they_were_not() -> None:
    d = np.array([1.0, np.nan, 2.0, -0.5])[:, None]
    kept = np.array([0, 2, 3])
    signs = draw_signs(4, seed=0, num_flips=100)
    found, expected = sign_flip(d, signs), sign_flip(d[kept], signs[:, kept])
    for left, right in zip(found, expected, strict=True):
        np.testing.assert_array_equal(left, right)


@given(DIFFERENCES.filter(lambda d: len(d) > 1 and any(d)))
def test_dividing_flips_by_their_standard_error_changes_no_p(differences: list[float]) -> None:
    d = np.array(differences)
    signs = all_signs(len(d))
    flipped = signs * d
    mean = np.abs(flipped.mean(axis=1))
    # t as a function of the mean at a fixed sum of squares, free of the rounding of a variance near 0.
    square = np.mean(d**2)
    t = mean / np.sqrt(np.maximum(square - mean**2, 1e-12))
    observed = np.abs(d.mean()) / np.sqrt(max(square - d.mean() ** 2, 1e-12))
    count = np.count_nonzero(t >= observed * (1 - 1e-9))
    assert sign_flip(d[:, None], signs).p[0] == pytest.approx((1 + count) / (len(signs) + 1))


def test_the_test_holds_its_level_for_symmetric_differences() -> None:
    d = np.random.default_rng(0).normal(size=(40, 600))
    assert 0.03 < np.mean(sign_flip(d, draw_signs(40, seed=0, num_flips=1000)).p <= 0.05) < 0.075


def test_flips_of_clusters_give_all_groups_of_a_cluster_one_sign() -> None:
    names = ["b", "a", "c", "b", "b", "c", "d"]
    d = np.array([0.4, -0.1, 0.9, 0.3, np.nan, 0.2, np.nan])
    signs = draw_signs(4, seed=1, num_flips=200, stream=CLUSTER_STREAM)
    there = [g for g in range(7) if not np.isnan(d[g])]
    reached = 0
    for flip in signs:
        sign = dict(zip("abcd", flip, strict=True))
        reached += abs(np.mean([sign[names[g]] * d[g] for g in there])) >= abs(d[there].mean()) - 1e-12
    found = sign_flip(d[:, None], signs, Clusters.of(names))
    assert found.mean[0] == pytest.approx(d[there].mean())
    assert found.p[0] == (1 + reached) / 201
    assert found.num_units[0] == 3


def test_clusters_of_one_group_are_tested_like_groups() -> None:
    d = np.random.default_rng(3).normal(0.2, 1, (50, 4))
    groups = sign_flip(d, draw_signs(50, seed=0))
    clusters = sign_flip(d, draw_signs(50, seed=0, stream=CLUSTER_STREAM), Clusters.of(alone(50)))
    np.testing.assert_allclose(clusters.mean, groups.mean, rtol=1e-12)
    np.testing.assert_allclose(clusters.p, groups.p, atol=0.02)
    np.testing.assert_array_equal(clusters.num_units, groups.num_units)
    assert (clusters.p != groups.p).any()


def test_a_single_cluster_is_never_significant() -> None:
    signs = draw_signs(1, seed=0, stream=CLUSTER_STREAM)
    found = sign_flip(np.full((30, 1), 1e5), signs, Clusters.of(["one"] * 30))
    assert (found.p[0], found.is_smallest[0], found.num_units[0]) == (1.0, False, 1)


def test_flips_of_clusters_keep_the_level_where_groups_are_correlated_and_those_of_groups_do_not() -> None:
    """Differences with an intra-cluster correlation of 0.8 and no effect, 50 clusters of two groups."""
    rng = np.random.default_rng(0)
    d = np.sqrt(0.8) * np.repeat(rng.normal(size=(50, 600)), 2, axis=0) + np.sqrt(0.2) * rng.normal(size=(100, 600))
    clusters = Clusters.of(pairs(100))
    by_clusters = sign_flip(d, draw_signs(50, seed=0, num_flips=1000, stream=CLUSTER_STREAM), clusters)
    assert 0.03 < np.mean(by_clusters.p <= 0.05) < 0.075
    assert np.mean(sign_flip(d, draw_signs(100, seed=0, num_flips=1000)).p <= 0.05) > 0.11


def test_the_studentised_bootstrap_is_the_formula_of_repeated_groups() -> None:
    d = np.array([0.3, -0.2, 1.4, 0.9, np.nan, 0.1, 2.5])
    counts = design(alone(7), seed=2, num_resamples=99)[1:100]
    kept = d[~np.isnan(d)]
    observed = abs(kept.mean()) / kept.std()
    reached = 0
    for row in counts.astype(int):
        sample = np.repeat(d, row)
        sample = sample[~np.isnan(sample)]
        spread = sample.std() if sample.size else 0.0
        reached += spread < 1e-9 or abs(sample.mean() - kept.mean()) / spread >= observed
    assert studentised_p(d[:, None], counts)[0] == (1 + reached) / 100


def test_the_studentised_bootstrap_is_near_the_t_test_for_normal_differences() -> None:
    d = np.random.default_rng(1).normal(0.25, 1, (80, 5))
    counts = design(alone(80), seed=0)[1:2001]
    np.testing.assert_allclose(studentised_p(d, counts), ttest_1samp(d, 0).pvalue, atol=0.03)


def test_the_studentised_bootstrap_keeps_its_level_better_when_differences_are_skewed() -> None:
    d = np.random.default_rng(4).lognormal(sigma=1.0, size=(40, 800)) - np.exp(0.5)
    flipped = np.mean(sign_flip(d, draw_signs(40, seed=0, num_flips=1000)).p <= 0.05)
    studentised = np.mean(studentised_p(d, design(alone(40), seed=0, num_resamples=999)[1:1000]) <= 0.05)
    assert studentised < flipped


def test_shapes_that_do_not_match_are_refused() -> None:
    with pytest.raises(ValueError, match="do not match"):
        sign_flip(np.zeros((4, 1)), draw_signs(5, seed=0, num_flips=10))
    with pytest.raises(ValueError, match="do not match"):
        sign_flip(np.zeros((4, 1)), draw_signs(4, seed=0, num_flips=10), Clusters.of(pairs(4)))
