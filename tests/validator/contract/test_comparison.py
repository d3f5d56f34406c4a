"""Comparison of documents: every difference by its place, nothing where there is none."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each

from branchdrive.contract.comparison import document_problems

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=10,
)


@given(JSON)
def test_a_document_does_not_differ_from_itself(document: Any) -> None:
    assert document_problems(document, document) == []


@each(
    ("expected", "found", "problems"),
    [
        ({"a": 1}, {"a": 2}, [("/a", "1", "2")]),
        ({"a": 1}, {}, [("/a", "1", "nothing")]),
        ({}, {"a/b~": "x"}, [("/a~1b~0", "nothing", "'x'")]),
        ([1, 2], [1], [("", "2 entries", "1 entries")]),
        ([1, [2, 3]], [1, [2, 4]], [("/1/1", "3", "4")]),
        (1, True, [("", "1", "True")]),
        (None, 0, [("", "None", "0")]),
        ([], {}, [("", "[]", "{}")]),
        ({"a": 0.1, "b": "x"}, {"a": 0.2, "b": "y"}, [("/a", "0.1", "0.2"), ("/b", "'x'", "'y'")]),
        ("é\n", "", [("", r"'\xe9\n'", "''")]),
        (1.0, math.nan, [("", "1.0", "nan")]),
    ],
)
def test_a_difference_is_told_by_pointer_expected_and_found(expected: Any, found: Any, problems: Any) -> None:
    assert document_problems(expected, found) == problems


def test_an_integer_is_the_fraction_of_its_value() -> None:
    assert document_problems({"a": 1}, {"a": 1.0}) == []


@pytest.mark.parametrize(("found", "is_problem"), [(100 + 1e-8, False), (100 + 1.1e-7, True), (100 - 1.1e-7, True)])
def test_numbers_may_differ_by_the_tolerance(found: float, is_problem: bool) -> None:
    assert bool(document_problems(100.0, found, tolerance=1e-9)) == is_problem


def test_what_is_shown_is_short() -> None:
    (problem,) = document_problems("x" * 1000, None)
    assert len(problem.expected) == 80
