"""Wrapped angles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.driving.angle import cos_sin, wrap_rad


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


def test_cosine_and_sine_are_those_of_the_library_but_for_a_last_bit() -> None:
    angles = np.concatenate([np.linspace(-math.pi, math.pi, 10_001), np.arange(-8, 9) * math.pi / 4])
    cos, sin = cos_sin(angles)
    np.testing.assert_allclose(cos, [math.cos(angle) for angle in angles.tolist()], rtol=0, atol=4e-16)
    np.testing.assert_allclose(sin, [math.sin(angle) for angle in angles.tolist()], rtol=0, atol=4e-16)
    far = np.linspace(-500, 500, 9_000).reshape(3, -1)
    np.testing.assert_allclose(cos_sin(far), [np.cos(far), np.sin(far)], rtol=0, atol=1e-13)


@given(st.floats(-7, 7))
def test_cosine_and_sine_are_sums_and_products_of_rounded_numbers(angle: float) -> None:
    """The table of spec/13-leakage.md#arithmetic, in Python's own numbers."""
    turns = float(np.rint(angle * (2 / math.pi)))
    r = angle - turns * (math.pi / 2)
    q, c, s = r * r, 0.0, 0.0
    for n in range(8, -1, -1):
        c = c * q + (-1) ** n / math.factorial(2 * n)
    for n in range(7, -1, -1):
        s = s * q + (-1) ** n / math.factorial(2 * n + 1)
    s *= r
    expected = {0: (c, s), 1: (-s, c), 2: (-c, -s), 3: (s, -c)}[int(turns) % 4]
    assert tuple(map(float, cos_sin(angle))) == expected


def test_no_angle_has_no_cosine() -> None:
    angles = [math.nan, math.inf, 2.0**31, 1e300, math.nextafter(2.0**31, 0), 0.0]
    assert np.isnan(cos_sin(angles)).tolist() == [[True] * 4 + [False] * 2] * 2
    assert cos_sin(np.zeros((2, 0)))[1].shape == (2, 0)
