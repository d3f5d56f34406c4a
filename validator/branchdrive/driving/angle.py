"""Angles on the circle, in arithmetic that every processor rounds alike.

Source: spec/13-leakage.md#arithmetic.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["cos_sin", "wrap_rad"]

Array = NDArray[np.float64]

_COS = [(-1) ** n / math.factorial(2 * n) for n in range(9)]
_SIN = [(-1) ** n / math.factorial(2 * n + 1) for n in range(8)]
_ANGLES_AT_ONCE = 4096
_FURTHEST_RAD = 2.0**31


def wrap_rad(angle_rad: ArrayLike) -> NDArray[np.float64]:
    """The angle in ``[-pi, pi]`` that points the same way, of any shape; odd, and exact where nothing is wrapped."""
    angle = np.asarray(angle_rad, np.float64)
    return np.asarray(angle - 2 * np.pi * np.rint(angle / (2 * np.pi)))


def cos_sin(angle_rad: ArrayLike) -> tuple[Array, Array]:
    """Cosine and sine of an angle of any shape, equal in every bit on every machine; within 2e-16 in ``[-pi, pi]``.

    With ``k = rint(2 a / pi)`` quarter turns and ``r = a - k (pi / 2)``, sums of Taylor terms by Horner's scheme::

        cos r = sum_{n = 0 .. 8} (-1)^n r^(2 n) / (2 n)!        sin r = r sum_{n = 0 .. 7} (-1)^n r^(2 n) / (2 n + 1)!

    Further angles lose about 1e-16 for every quarter turn; from ``2^31`` on both are NaN.
    """
    angle = np.asarray(angle_rad, np.float64)
    angle = np.where(np.abs(angle) < _FURTHEST_RAD, angle, np.nan)
    flat = angle.reshape(-1)
    cos, sin = np.empty_like(flat), np.empty_like(flat)
    for start in range(0, len(flat), _ANGLES_AT_ONCE):  # blocks that stay in the cache
        part = slice(start, start + _ANGLES_AT_ONCE)
        cos[part], sin[part] = _cos_sin(flat[part])
    return cos.reshape(angle.shape), sin.reshape(angle.shape)


def _cos_sin(angle: Array) -> tuple[Array, Array]:
    turns = np.rint(angle * (2 / np.pi))
    r = angle - turns * (np.pi / 2)
    square = r * r
    c, s = _horner(_COS, square), _horner(_SIN, square)
    s *= r
    # Of the factors of a quarter turn, its own cosine and sine, one is 0 and the other 1 or -1.
    quarter = turns - 4 * np.rint(turns * 0.25)
    size = np.abs(quarter)
    across = (2 - size) * quarter
    along = np.subtract(1, size, out=size)
    return c * along - s * across, s * along + c * across


def _horner(coefficients: list[float], x: Array) -> Array:
    """``sum_n coefficients[n] x^n``."""
    total = x * coefficients[-1]
    for coefficient in coefficients[-2:0:-1]:
        total += coefficient
        total *= x
    total += coefficients[0]
    return total
