"""Frames: joined, sorted and paired by key, whatever the order of their rows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.tables.frame import Frame, align, concat, num_rows, repeated_rows, sort_rows, take

KEY = ("group_id", "step")
KEYS = st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 3)), max_size=12)


def frame(keys: list[tuple[str, int]]) -> Frame:
    return {
        "group_id": np.array([group for group, _ in keys], object),
        "step": np.array([step for _, step in keys], np.int64),
    }


def keys_of(rows: Frame) -> list[tuple[str, int]]:
    return list(zip(rows["group_id"].tolist(), rows["step"].tolist(), strict=True))


@given(KEYS.map(lambda keys: list(dict.fromkeys(keys))), KEYS)
def test_rows_are_paired_by_key(expected: list[tuple[str, int]], found: list[tuple[str, int]]) -> None:
    pairs = align(frame(expected), frame(found), KEY)
    assert [expected[i] for i in pairs.expected] == [found[i] for i in pairs.found]
    assert {expected[i] for i in pairs.missing} == set(expected) - set(found)
    assert len(pairs.found) + len(pairs.extra) == len(found)
    assert set(pairs.found.tolist()).isdisjoint(pairs.extra.tolist())


@given(KEYS)
def test_repeated_rows_are_those_after_the_first(keys: list[tuple[str, int]]) -> None:
    wanted = [row for row, key in enumerate(keys) if key in keys[:row]]
    assert repeated_rows(frame(keys), KEY).tolist() == wanted


def test_nulls_in_a_key_are_equal_to_each_other_and_to_no_text() -> None:
    rows = {"group_id": np.array([None, "", None, "None"], object)}
    assert repeated_rows(rows, ("group_id",)).tolist() == [2]


def test_keys_of_more_values_than_one_number_can_tell_apart() -> None:
    columns = {f"part {i}": np.append(np.roll(np.arange(32), i), np.roll(np.arange(32), i)[5]) for i in range(14)}
    assert repeated_rows(columns, [*columns]).tolist() == [32]
    last = {**columns, "part 13": np.append(columns["part 13"][:-1], 31)}
    assert repeated_rows(last, [*last]).tolist() == []
    assert align(take(columns, np.arange(32)), columns, [*columns]).extra.tolist() == [32]


@given(KEYS)
def test_rows_are_sorted_by_key(keys: list[tuple[str, int]]) -> None:
    assert keys_of(sort_rows(frame(keys), KEY)) == sorted(keys)


def test_words_follow_a_given_order() -> None:
    rows = frame([("a", 0), ("b", 0), ("c", 0), ("b", 1)])
    assert keys_of(sort_rows(rows, KEY, {"group_id": ("c", "b", "a")})) == [("c", 0), ("b", 0), ("b", 1), ("a", 0)]


def test_frames_are_joined_with_their_masks() -> None:
    parts = [{"x": np.ma.masked_array([1, 2], [False, True])}, {"x": np.array([3])}]
    joined = concat(parts)["x"]
    assert joined.tolist() == [1, None, 3]
    assert num_rows({}) == 0
    assert take({"x": joined}, np.array([2]))["x"].tolist() == [3]


@pytest.mark.parametrize("parts", [[], [{"x": np.zeros(1)}, {"y": np.zeros(1)}]])
def test_frames_of_other_columns_are_not_joined(parts: list[Frame]) -> None:
    with pytest.raises(ValueError, match="same columns"):
        concat(parts)
