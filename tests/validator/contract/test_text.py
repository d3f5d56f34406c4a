"""Values as text: short, and never more or less than the value."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.contract.text import quote


@given(st.floats(width=32, allow_nan=False))
def test_a_float32_is_told_apart_by_its_text(value: float) -> None:
    single = np.float32(value)
    text = quote(single)
    assert np.float32(text) == single
    assert len(text) <= len(repr(float(single)))


def test_a_float32_has_the_digits_that_were_written() -> None:
    values = [0.3, 0.1, -1.5, 100.0, 1e-10, float("inf")]
    assert [quote(np.float32(value)) for value in values] == ["0.3", "0.1", "-1.5", "100.0", "1e-10", "inf"]
    assert quote(np.array(0.3, np.float32)) == "0.3"


def test_a_float64_keeps_all_its_digits() -> None:
    assert quote(np.float64(np.float32(0.3))) == "0.30000001192092896"
    assert quote(0.1 + 0.2) == "0.30000000000000004"
