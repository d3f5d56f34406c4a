"""Labels of permutations, p-values, those that fit the first permutations, and critical values."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each

from branchdrive.statistics.permutation import critical_value, identity, is_plausible, labels, p_value
from branchdrive.statistics.random_words import group_orders


def test_labels_sum_the_rows_that_an_action_gets() -> None:
    rows = group_orders(2, "leakage/permutations", 5, 4, 3)
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


@each(
    ("reached", "drawn", "p", "expected"),
    [
        (93, 199, 0.4658, True),
        (93, 199, 1.0, False),
        (93, 199, 0.85, False),
        (199, 199, 1.0, True),
        (198, 199, 1.0, True),
        (197, 199, 1.0, False),
        (0, 199, 1 / 10_000, True),
        (3, 199, 1 / 10_000, False),
        (0, 199, 0.05, True),
        (0, 199, 0.2, False),
        (0, 9_999, 2 / 10_000, True),
        (0, 9_999, 3 / 10_000, False),
    ],
)
def test_counts_fit_p_values(reached: int, drawn: int, p: float, expected: bool) -> None:
    assert is_plausible(reached, drawn, p, 9_999) is expected
