"""Wrapped angles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.derive.angle import wrap_rad


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [(0, 0), (1, 1), (-3, -3), (4, 4 - 2 * math.pi), (-4, 2 * math.pi - 4), (7, 7 - 2 * math.pi), (20 * math.pi, 0)],
)
def test_angle_is_wrapped(angle: float, wrapped: float) -> None:
    assert wrap_rad(angle) == pytest.approx(wrapped, abs=1e-14)


@given(st.floats(-1e3, 1e3))
def test_wrapping_keeps_the_direction_and_the_range(angle: float) -> None:
    wrapped = float(wrap_rad(angle))
    assert abs(wrapped) <= math.pi + 1e-12
    assert (math.cos(wrapped), math.sin(wrapped)) == pytest.approx((math.cos(angle), math.sin(angle)), abs=1e-9)
    assert float(wrap_rad(-angle)) == -wrapped


@given(st.floats(-3.14, 3.14))
def test_what_needs_no_wrapping_is_not_touched(angle: float) -> None:
    assert float(wrap_rad(angle)) == angle


def test_shape_is_kept() -> None:
    assert wrap_rad(np.zeros((2, 3))).shape == (2, 3)
