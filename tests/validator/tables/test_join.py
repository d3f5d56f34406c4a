"""Joins on keys of whole numbers, against pairs of rows that are compared one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.tables.join import KeyIndex, find_sorted

SMALL, LARGE = st.integers(-3, 3), st.sampled_from([-(2**31), -1, 0, 1, 2**31 - 1, 2**62])


def keys(number: st.SearchStrategy[int]) -> st.SearchStrategy[list[tuple[int, ...]]]:
    return st.lists(st.tuples(number, number, number), max_size=12)


both = st.one_of(st.tuples(keys(number), keys(number)) for number in (SMALL, LARGE, SMALL | LARGE))


def columns(rows: list[tuple[int, ...]]) -> list[np.ndarray]:
    return [np.array([row[part] for row in rows], np.int64) for part in range(3)]


@given(both)
def test_a_key_is_found_in_its_first_row(tables: tuple[list[tuple[int, ...]], list[tuple[int, ...]]]) -> None:
    rows, wanted = tables
    found = KeyIndex(*columns(rows)).find(*columns(wanted))
    assert found.tolist() == [rows.index(key) if key in rows else -1 for key in wanted]


@given(both)
def test_the_last_row_before_is_the_one_with_the_largest_last_part(
    tables: tuple[list[tuple[int, ...]], list[tuple[int, ...]]],
) -> None:
    rows, wanted = tables
    found = KeyIndex(*columns(rows)).last_before(*columns(wanted)).tolist()
    for (*others, last), row in zip(wanted, found, strict=True):
        before = [(key[2], place) for place, key in enumerate(rows) if [*key[:2]] == others and key[2] < last]
        assert row == max(before, default=(0, -1))[1]


def test_parts_share_a_shape() -> None:
    index = KeyIndex(np.array([0, 0, 1]), np.array([5, 7, 5]))
    np.testing.assert_array_equal(index.find(np.array([[0], [1]]), np.array([5, 7])), [[0, 1], [2, -1]])
    np.testing.assert_array_equal(index.find(np.array([0, 1, 2]), 5), [0, 2, -1])


def test_keys_of_any_order_are_found_where_they_stand() -> None:
    assert KeyIndex(np.array([9, 2, 9, 4])).find(np.array([9, 4, 3])).tolist() == [0, 3, -1]


@pytest.mark.parametrize("keys_", [np.zeros(0, np.int64), np.array([1, 3, 3, 8])])
def test_places_among_sorted_keys(keys_: np.ndarray) -> None:
    found = find_sorted(keys_, np.arange(10))
    listed = keys_.tolist()
    assert found.tolist() == [listed.index(key) if key in listed else -1 for key in range(10)]
