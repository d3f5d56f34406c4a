"""Permutations: what they are, that chunks change nothing, p-values and critical values."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare

from branchdrive.statistics.permutation import critical_value, draw, identity, labels, p_value


@pytest.mark.parametrize("num_actions", [2, 3, 12, 16, 17])
def test_every_group_gets_a_permutation(num_actions: int) -> None:
    rows = draw(0, 20, 7, num_actions, seed=3)
    assert rows.shape == (20, 7, num_actions)
    assert (np.sort(rows, axis=2) == np.arange(num_actions)).all()


def test_permutations_are_uniform_and_groups_independent() -> None:
    rows = draw(0, 6_000, 2, 3, seed=1)
    names = {order: i for i, order in enumerate(permutations(range(3)))}
    code = np.array([[names[tuple(group)] for group in one] for one in rows.tolist()])
    assert chisquare(np.bincount(code[:, 0] * 6 + code[:, 1], minlength=36)).pvalue > 0.001


@given(st.integers(0, 30), st.integers(1, 9), st.integers(1, 5))
def test_a_permutation_depends_on_its_number_alone(start: int, length: int, num_groups: int) -> None:
    whole = draw(0, 40, num_groups, 5, seed=9)
    np.testing.assert_array_equal(draw(start, start + length, num_groups, 5, seed=9), whole[start : start + length])


def test_seeds_and_streams_give_different_permutations() -> None:
    found = [draw(0, 3, 4, 6, seed=seed) for seed in (0, 1, 2**64 - 1)] + [draw(0, 3, 4, 6, seed=0, stream="another")]
    assert len({rows.tobytes() for rows in found}) == 4


@pytest.mark.parametrize("seed", [-1, 2**64])
def test_seeds_have_64_bits(seed: int) -> None:
    with pytest.raises(ValueError, match="`seed` is"):
        draw(0, 1, 2, 3, seed=seed)


def test_labels_sum_the_rows_that_an_action_gets() -> None:
    rows = draw(0, 5, 4, 3, seed=2)
    table = np.arange(4 * 3 * 2).reshape(4, 3, 2) ** 2
    sums = (labels(rows) @ table.reshape(12, 2)).reshape(5, 3, 2)
    for b in range(5):
        for action in range(3):
            expected = sum(table[group, rows[b, group, action]] for group in range(4))
            np.testing.assert_array_equal(sums[b, action], expected)


def test_the_identity_gives_every_action_its_own_row() -> None:
    np.testing.assert_array_equal(labels(identity(3, 2)), np.tile(np.eye(2), 3))


@given(st.floats(-3, 3), st.lists(st.integers(-3, 3), min_size=1, max_size=30))
def test_p_counts_the_observed_labels_as_one_permutation(observed: float, null: list[int]) -> None:
    expected = (1 + sum(value >= observed - 1e-9 * abs(observed) - 1e-12 for value in null)) / (len(null) + 1)
    assert p_value(observed, np.array(null, float)) == expected


def test_rounding_does_not_break_ties() -> None:
    assert p_value(0.1 + 0.2, np.array([0.3])) == 1.0
    assert p_value(3e-17, np.array([0.0, -2e-17])) == 1.0


@given(
    st.floats(-3, 3),
    st.lists(st.integers(-3, 3), min_size=1, max_size=60),
    st.sampled_from([0.001, 0.01, 0.05, 0.1, 0.5, 0.9]),
)
def test_beyond_the_critical_value_is_where_p_is_at_most_alpha(observed: float, null: list[int], alpha: float) -> None:
    distribution = np.array(null, float)
    if np.abs(distribution - observed).min() > 1e-6:
        assert (observed > critical_value(distribution, alpha)) == (p_value(observed, distribution) <= alpha)


@pytest.mark.parametrize(("num_permutations", "expected"), [(9_999, 9_998.0), (3_999, 3_999.0), (3_998, np.inf)])
def test_the_level_of_the_gate_lies_in_the_far_tail(num_permutations: int, expected: float) -> None:
    assert critical_value(np.arange(1.0, num_permutations + 1), 0.001 / 4) == expected
