"""Comparison of columns: which cells differ, by analytic cases; and checks of documents."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each
from tests.mismatch import rows

from branchdrive.contract.mismatch import Mismatch
from branchdrive.layers.compare import differs, document_check, text_mismatches

INF, NAN = math.inf, math.nan


class Cells(NamedTuple):
    """A pair of cells, and whether they differ where they were computed and where they were copied."""

    expected: Any
    found: Any
    computed: bool
    copied: bool


CELLS: dict[str, Cells] = {
    "equal": Cells(0.1, 0.1, False, False),
    "last bit": Cells(0.1, np.nextafter(0.1, 1), False, True),
    "within the tolerance": Cells(100.0, 100 + 1e-7, False, True),
    "beyond the tolerance": Cells(100.0, 100 + 1.1e-7, True, True),
    "signed zero": Cells(0.0, -0.0, False, True),
    "NaN twice": Cells(NAN, NAN, True, True),
    "NaN stored": Cells(1.0, NAN, True, True),
    "NaN expected": Cells(NAN, 1.0, True, True),
    "infinity twice": Cells(INF, INF, False, False),
    "infinities of two signs": Cells(INF, -INF, True, True),
    "infinity stored": Cells(1.0, INF, True, True),
    "infinity expected": Cells(INF, 1.0, True, True),
    "fraction, integer stored": Cells(2.0, 2, False, False),
    "integer, fraction stored": Cells(2, 2 + 1e-12, True, True),
    "integers": Cells(2**62, 2**62 + 1, True, True),
    "false and 0": Cells(False, 0, False, False),  # types of columns are judged by other rules
    "flags": Cells(True, False, True, True),
    "text": Cells("left", "left", False, False),
    "other text": Cells("left", "left ", True, True),
}


def column(value: Any) -> Any:
    return np.array([value], object if isinstance(value, str) else None)


@each("name", CELLS)
@pytest.mark.parametrize("exact", [False, True])
def test_cells_differ_as_computed_and_as_copied_numbers_do(name: str, exact: bool) -> None:
    case = CELLS[name]
    apart = differs(column(case.expected), column(case.found), exact=exact)
    assert (apart.dtype, apart.tolist()) == (np.dtype(bool), [case.copied if exact else case.computed])


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("values", [[1.0, 2.0, NAN, 4.0], [1, 2, 3, 4], ["a", "b", "c", "d"]], ids=["f", "i", "text"])
def test_null_agrees_with_null_alone_whatever_lies_below(values: list[Any], exact: bool) -> None:
    dtype = object if isinstance(values[0], str) else None
    expected = np.ma.masked_array(np.array(values, dtype), [False, False, True, True])
    found = np.ma.masked_array(np.array([*values[:2], *values[:2]], dtype), [False, True, True, False])
    assert differs(expected, found, exact=exact).tolist() == [False, True, False, True]


def test_a_column_without_mask_has_no_null() -> None:
    found = np.ma.masked_array([1.0, 2.0], [True, False])
    assert differs(np.array([1.0, 2.0]), found).tolist() == [True, False]
    assert differs(found, np.array([1.0, 2.0])).tolist() == [True, False]


@given(st.lists(st.floats(allow_nan=False)), st.booleans())
def test_a_column_does_not_differ_from_itself(values: list[float], exact: bool) -> None:
    assert not differs(np.array(values), np.array(values), exact=exact).any()


def test_a_check_of_a_document_places_its_mismatches_in_the_file() -> None:
    mismatches = [Mismatch({"pointer": "/a"}, "1", "2"), Mismatch({"pointer": "/"}, "x", "y", count=3)]
    check = document_check("quality/split.json", 1, mismatches)
    assert (check.num_examined, check.bad.tolist()) == (2, [0, 1])
    assert check.mismatch(1) == Mismatch({"file": "quality/split.json", "pointer": "/"}, "x", "y", 3)
    assert not len(document_check("quality/split.json", 4).bad)


def test_texts_of_a_document_are_shown_as_they_are() -> None:
    assert rows(text_mismatches("/digest", "é", "e")) == [("/digest", "é", "e")]
    assert not list(text_mismatches("/digest", "é", "é"))
