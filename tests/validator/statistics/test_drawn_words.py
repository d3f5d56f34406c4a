"""Streams: what a word depends on, and what is made of words."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare

from branchdrive.statistics.random_words import below, bits, group_orders, orders, words

PINNED = ["0x6490e71440374d02", "0xae38fa279272dbf4", "0xbecca8097aeffa50"]


def test_the_first_words_are_pinned() -> None:
    assert [hex(word) for word in words(7, "metric/bootstrap", 1, 3)[0].tolist()] == PINNED


@pytest.mark.parametrize("num_columns", [1, 4, 5])
def test_a_row_depends_on_its_number_alone(num_columns: int) -> None:
    whole = words(3, "a", 12, num_columns)
    assert whole.shape == (12, num_columns)
    np.testing.assert_array_equal(words(3, "a", 5, num_columns, first_row=4), whole[4:9])


def test_seeds_and_names_give_different_words() -> None:
    found = {words(seed, name, 1, 4).tobytes() for seed in (0, 1, 2**64 - 1) for name in ("a", "b")}
    assert len(found) == 6


@pytest.mark.parametrize("seed", [-1, 2**64])
def test_seeds_have_64_bits(seed: int) -> None:
    with pytest.raises(ValueError, match="`seed` is"):
        words(seed, "a", 1, 1)


def test_integers_below_a_limit_are_uniform() -> None:
    drawn = below(words(0, "a", 100, 70), 7)
    assert set(np.unique(drawn).tolist()) == set(range(7))
    assert chisquare(np.bincount(drawn.ravel())).pvalue > 0.001


def test_the_ends_of_a_word_map_to_the_ends_of_the_range() -> None:
    ends = np.array([0, 2**64 - 1, 2**63, 2**63 - 1], np.uint64)
    np.testing.assert_array_equal(below(ends, 10), [0, 9, 5, 4])


def test_bits_run_from_the_lowest_of_the_first_word() -> None:
    found = bits(np.array([[5, 1]], np.uint64), 66)
    np.testing.assert_array_equal(np.flatnonzero(found[0]), [0, 2, 64])


def test_orders_sort_the_words_and_equal_ones_by_place() -> None:
    found = orders(np.array([[12, 36, 4], [8, 9, 11]], np.uint64))
    np.testing.assert_array_equal(found, [[2, 0, 1], [0, 1, 2]])


@pytest.mark.parametrize("num_actions", [2, 3, 12, 16, 17])
def test_every_group_gets_an_order(num_actions: int) -> None:
    rows = group_orders(3, "leakage/permutations", 20, 7, num_actions)
    assert rows.shape == (20, 7, num_actions)
    assert (np.sort(rows, axis=2) == np.arange(num_actions)).all()


def test_orders_are_uniform_and_groups_independent() -> None:
    rows = group_orders(1, "leakage/permutations", 6_000, 2, 3)
    names = {order: i for i, order in enumerate(permutations(range(3)))}
    code = np.array([[names[tuple(group)] for group in one] for one in rows.tolist()])
    assert chisquare(np.bincount(code[:, 0] * 6 + code[:, 1], minlength=36)).pvalue > 0.001


@given(st.integers(0, 30), st.integers(1, 9), st.integers(1, 5))
def test_orders_depend_on_the_number_of_their_row_alone(start: int, length: int, num_groups: int) -> None:
    whole = group_orders(9, "a", 40, num_groups, 5)
    part = group_orders(9, "a", length, num_groups, 5, first_row=start)
    np.testing.assert_array_equal(part, whole[start : start + length])


def test_seeds_and_streams_give_different_orders() -> None:
    found = [group_orders(seed, name, 3, 4, 6) for seed, name in ((0, "a"), (1, "a"), (2**64 - 1, "a"), (0, "b"))]
    assert len({rows.tobytes() for rows in found}) == 4
