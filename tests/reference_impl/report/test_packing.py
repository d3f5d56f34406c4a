"""Packed numbers come back as they were, whatever they are."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from tests.reference_impl.report.reading import whole_numbers

from branchdrive_reference.report.packing import LARGEST, MISSING, Packer, quantised

NUMBERS = st.lists(st.one_of(st.integers(-LARGEST, LARGEST), st.just(0), st.just(MISSING)), max_size=60)


@given(st.lists(st.tuples(NUMBERS, st.integers(1, 2)), max_size=4))
def test_series_come_back_in_their_order(series: list[tuple[list[int], int]]) -> None:
    packer = Packer()
    for values, order in series:
        packer.add(np.array(values, np.int64), order=order)
    counts = [(len(values), order) for values, order in series]
    assert whole_numbers(packer.text().encode(), counts) == [values for values, _ in series]


def test_a_series_that_keeps_its_pace_is_a_few_bytes() -> None:
    packer = Packer()
    packer.add(np.arange(0, 50_000, 50), order=2)
    assert len(packer.text()) <= 16


def test_what_is_no_number_is_missing() -> None:
    values = np.array([np.nan, np.inf, -np.inf, 1e12, 0.0, -0.26])
    assert quantised(values, 0.5).tolist() == [MISSING] * 4 + [0, -1]
