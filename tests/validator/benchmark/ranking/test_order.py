"""Concordance and NDCG: analytic cases, the paper's rows of fixed selectors, scipy and scikit-learn."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from branchdrive.benchmark.ranking.measure import concordance, ndcg

Array = NDArray[np.float64]
rows = arrays(np.float64, (3, 5), elements=st.integers(0, 8).map(lambda step: step / 8))


def test_right_wrong_and_tied_orders() -> None:
    truth = np.array([[0.1, 0.5, 0.9]] * 3)
    assert concordance(np.array([[1.0, 2, 3], [3, 2, 1], [7, 7, 7]]), truth).tolist() == [1, 0, 0.5]


def test_truth_ties_are_dropped_and_score_ties_count_one_half() -> None:
    # Of three pairs one is a tie of the truth, one is right, and one is a tie of scores.
    assert concordance(np.array([[1.0, 5.0, 5.0]]), np.array([[0.2, 0.2 + 1e-10, 0.7]])).tolist() == [0.75]


def test_a_group_without_differences_has_no_concordance() -> None:
    assert np.isnan(concordance(np.array([[1.0, 2.0]]), np.array([[0.4, 0.4]]))).all()


def test_a_fixed_selector_is_right_by_its_rank_alone() -> None:
    # One-hot scores decide 12 of 78 pairs, as the paper's row of the nominal candidate shows.
    truth = np.linspace(0, 1, 13)[None]
    for place in range(13):
        found = concordance(np.eye(13)[place][None], truth)
        assert found == pytest.approx(0.5 + 12 / 78 * (place / 12 - 0.5))


def test_the_ideal_order_has_ndcg_one_and_a_known_one_its_own() -> None:
    gains = np.array([[0.0, 1.0, 0.5]])
    assert ndcg(gains, gains) == pytest.approx(1)
    ideal = 1 + 0.5 / np.log2(3)
    assert ndcg(np.array([[3.0, 2, 1]]), gains) == pytest.approx((1 / np.log2(3) + 0.5 / 2) / ideal)


def test_without_any_gain_every_order_is_the_best() -> None:
    assert ndcg(np.array([[1.0, 2.0]]), np.zeros((1, 2))).tolist() == [1]


def test_a_negative_gain_is_refused() -> None:
    with pytest.raises(ValueError, match="a utility is negative"):
        ndcg(np.zeros((1, 2)), np.array([[-0.1, 0.2]]))


@given(rows, rows)
def test_tied_scores_stand_for_the_mean_over_their_orders(scores: Array, gains: Array) -> None:
    score, gain = scores[:1, :4], gains[:1, :4] + 0.1
    found = [
        ndcg(np.array([order], float), gain)[0]
        for order in itertools.permutations(range(4))
        if all(order[i] > order[j] for i, j in itertools.permutations(range(4), 2) if score[0, i] > score[0, j])
    ]
    assert ndcg(score, gain)[0] == pytest.approx(np.mean(found))


@given(rows, rows)
def test_ndcg_is_that_of_scikit_learn(scores: Array, gains: Array) -> None:
    metrics = pytest.importorskip("sklearn.metrics")
    gains = gains + 0.01
    wanted = [metrics.ndcg_score(gain[None], score[None]) for score, gain in zip(scores, gains, strict=True)]
    np.testing.assert_allclose(ndcg(scores, gains), wanted, atol=1e-12)


@given(rows, rows)
def test_concordance_is_somers_d_of_scipy(scores: Array, gains: Array) -> None:
    stats = pytest.importorskip("scipy.stats")
    for score, gain, found in zip(scores, gains, concordance(scores, gains), strict=True):
        if np.ptp(gain) > 0 and np.ptp(score) > 0:
            with np.errstate(all="ignore"):  # its p-value, unused here, may divide by zero
                statistic = stats.somersd(gain, score).statistic
            assert found == pytest.approx((1 + statistic) / 2)
        elif np.ptp(gain) > 0:
            assert found == 0.5
        else:
            assert np.isnan(found)


@given(rows, rows, st.permutations(range(3)), st.permutations(range(5)))
def test_orders_of_groups_and_candidates_do_not_matter(
    scores: Array, gains: Array, groups: list[int], candidates: list[int]
) -> None:
    for measure in (concordance, ndcg):
        moved = measure(scores[groups][:, candidates], gains[groups][:, candidates])
        np.testing.assert_allclose(moved, measure(scores, gains)[groups], atol=1e-12)


@given(rows, rows)
def test_turning_the_scores_round_turns_concordance_round(scores: Array, gains: Array) -> None:
    np.testing.assert_allclose(concordance(-scores, gains), 1 - concordance(scores, gains), atol=1e-12)
