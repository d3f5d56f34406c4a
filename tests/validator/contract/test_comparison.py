"""Comparison of numbers and documents: every difference by its place, nothing where there is none."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each
from tests.mismatch import pointers, rows

from branchdrive.contract.comparison import TOLERANCE, agree, document_mismatches

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=10,
)
LARGEST, INF = 1.7976931348623157e308, math.inf

NUMBERS: dict[str, tuple[float, float, bool]] = {
    "equal": (0.1, 0.1, True),
    "at the tolerance of 0": (0.0, 1e-9, True),
    "beyond the tolerance of 0": (0.0, 1.1e-9, False),
    "within the tolerance of 100": (100.0, 100 + 1e-7, True),
    "beyond the tolerance of 100": (100.0, 100 + 1.1e-7, False),
    "below by more": (100.0, 100 - 1.1e-7, False),
    "of another sign": (-1.0, 1.0, False),
    "zeros of two signs": (0.0, -0.0, True),
    "an integer": (3.0, 3, True),
    "an integer of 20 digits": (10**19, 10**19 + 1, True),
    "NaN twice": (math.nan, math.nan, False),
    "NaN stored": (1.0, math.nan, False),
    "NaN expected": (math.nan, 1.0, False),
    "infinity twice": (INF, INF, True),
    "infinities of two signs": (INF, -INF, False),
    "infinity stored": (1.0, INF, False),
    "infinity expected": (INF, 1.0, False),
    "the largest of two signs": (LARGEST, -LARGEST, False),
}


@each("name", NUMBERS)
def test_numbers_agree_within_the_tolerance(name: str) -> None:
    expected, found, agreeing = NUMBERS[name]
    assert agree(expected, found) is agreeing


def test_numbers_of_arrays_agree_like_numbers() -> None:
    expected, found, agreeing = zip(*NUMBERS.values(), strict=True)
    assert agree(np.array(expected, float), np.array(found, float)).tolist() == list(agreeing)


@given(st.floats(-1e300, 1e300), st.floats(-0.99, 0.99))
def test_the_tolerance_grows_with_the_expected_number(expected: float, share: float) -> None:
    step = TOLERANCE * (1 + abs(expected))
    assert agree(expected, expected + share * step)
    assert not agree(expected, expected + math.copysign(1 + abs(share), share) * 1.001 * step)


@given(JSON)
def test_a_document_does_not_differ_from_itself(document: Any) -> None:
    assert not list(document_mismatches(document, document))


@each(
    ("expected", "found", "mismatches"),
    [
        ({"a": 1}, {"a": 2}, [("/a", "1", "2")]),
        ({"a": 1}, {}, [("/a", "1", "nothing")]),
        ({}, {"a/b~": "x"}, [("/a~1b~0", "nothing", "'x'")]),
        ([1, 2], [1], [("/", "2 entries", "1 entries")]),
        ([1, [2, 3]], [1, [2, 4]], [("/1/1", "3", "4")]),
        (1, True, [("/", "1", "True")]),
        (0, False, [("/", "0", "False")]),
        (None, 0, [("/", "None", "0")]),
        ([], {}, [("/", "[]", "{}")]),
        ({"a": 0.1, "b": "x"}, {"a": 0.2, "b": "y"}, [("/a", "0.1", "0.2"), ("/b", "'x'", "'y'")]),
        ("é\n", "", [("/", r"'\xe9\n'", "''")]),
        (1.0, math.nan, [("/", "1.0", "nan")]),
    ],
)
def test_a_difference_is_told_by_pointer_expected_and_found(expected: Any, found: Any, mismatches: Any) -> None:
    assert rows(document_mismatches(expected, found)) == mismatches


def test_a_part_of_a_document_is_told_by_its_place_in_the_whole() -> None:
    assert pointers(document_mismatches({"a": 1}, {"a": 2}, pointer="/part")) == ["/part/a"]
    assert pointers(document_mismatches([1], [], pointer="/part")) == ["/part"]


def test_an_integer_is_the_fraction_of_its_value() -> None:
    assert not list(document_mismatches({"a": 1}, {"a": 1.0}))


@pytest.mark.parametrize(("found", "is_other"), [(100 + 1e-8, False), (100 + 1.1e-7, True), (100 - 1.1e-7, True)])
def test_numbers_of_a_document_may_differ_by_the_tolerance(found: float, is_other: bool) -> None:
    assert bool(list(document_mismatches({"a": 100.0}, {"a": found}, tolerance=TOLERANCE))) == is_other
    assert list(document_mismatches({"a": 100.0}, {"a": found}))


def test_what_is_shown_is_short() -> None:
    (mismatch,) = document_mismatches("x" * 1000, None)
    assert len(mismatch.expected) == 80
