"""Streams: what a word depends on, and what is made of words."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chisquare

from branchdrive.statistics.stream import below, bits, orders, words

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
