"""Selectors: the choice, its ties, expectations of random choices, and the best fixed candidate."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from branchdrive.benchmark.ranking.measure import best_fixed, by_score, choose, fixed, uniform

scores = arrays(np.float64, (4, 6), elements=st.floats(-5, 5, width=16))


def test_the_best_score_is_chosen_and_ties_go_to_the_first() -> None:
    found = choose(np.array([[0.1, 0.9, 0.9 + 5e-10], [0.3, 0.3, 0.3], [0.1, 0.2, 0.2 + 1e-8]]))
    assert found.tolist() == [1, 0, 2]


def test_what_is_excluded_is_never_chosen() -> None:
    assert choose(np.array([[-np.inf, -7.0, -np.inf]])).tolist() == [1]


@pytest.mark.parametrize("row", [[np.nan, 1.0], [np.inf, 1.0], [-np.inf, -np.inf]])
def test_a_choice_needs_numbers(row: list[float]) -> None:
    with pytest.raises(ValueError, match="a choice needs scores that are numbers"):
        choose(np.array([row]))


@given(scores, st.permutations(range(4)))
def test_the_order_of_groups_does_not_matter(rows: np.ndarray, order: list[int]) -> None:
    assert choose(rows[order]).tolist() == choose(rows)[order].tolist()


@given(st.lists(st.integers(0, 500), min_size=6, max_size=6, unique=True), st.permutations(range(6)))
def test_the_order_of_candidates_does_not_matter_where_nothing_ties(row: list[int], order: list[int]) -> None:
    values = np.array([row]) / 100
    assert order[choose(values[:, order])[0]] == choose(values)[0]


def test_shares_add_up_to_one() -> None:
    rows = np.array([[0.1, 0.9], [0.8, 0.2]])
    for selector in (by_score(rows), fixed(1, 2, 2), uniform(2, 2)):
        assert selector.shares.sum(axis=1).tolist() == [1, 1]
    assert by_score(rows).shares.tolist() == [[0, 1], [1, 0]]
    assert fixed(1, 2, 2).scores.tolist() == [[0, 1], [0, 1]]
    assert uniform(1, 4).shares.tolist() == [[0.25] * 4]


def test_a_fixed_candidate_is_one_of_the_bank() -> None:
    with pytest.raises(ValueError, match=r"^candidate 3 is not in 0 \.\. 2$"):
        fixed(3, 1, 3)


def test_the_best_fixed_candidate_has_the_greatest_mean_over_ranked_groups() -> None:
    utilities = np.array([[0.5, 0.2, 0.6], [0.5, 0.9, 0.2], [np.nan, 0.0, 1.0]])
    assert best_fixed(utilities) == 1
    assert best_fixed(utilities, among=[2, 0]) == 0
    assert best_fixed(np.array([[0.3, 0.7, 0.7]])) == 1


def test_the_best_fixed_candidate_needs_groups_and_candidates() -> None:
    with pytest.raises(ValueError, match=r"^none of 1 groups has all its utilities"):
        best_fixed(np.array([[np.nan, 1.0]]))
    with pytest.raises(ValueError, match="`among` is empty"):
        best_fixed(np.ones((1, 2)), among=[])
