"""What rounding does not decide: sums that are the same in whatever order they are added, and numbers that tie.

Two numbers tie where they differ by at most ``1e-12 + 1e-9 s``, with ``s`` the magnitude of what they were computed
from. Ties are counted, so last bits, which differ between processors and languages, must not part them; and numbers
that differ for another reason than rounding differ by more.

A sum of products with whole numbers is rounded once::

    v = h + l + ..      h a multiple of 2^k, l one of 2^j, so coarse that all partial sums of multiples are exact
    sum_g c_g v_g = sum_g c_g h_g + sum_g c_g l_g

Source: Demmel and Nguyen 2015 (sums that can be reproduced), with two folds; the slack is this project's choice.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["RELATIVE_TIE", "TIE", "Counts", "WholeNumbers", "number", "numbers", "slack", "sums"]

Array = NDArray[np.float64]

TIE = 1e-12
RELATIVE_TIE = 1e-9

_DIGITS = 52
"""Binary digits of a partial sum, one fewer than are exact: multiples are rounded to the nearest."""

_MAX_CELLS = 1 << 22
"""Whole numbers that are held as float64 at once: 32 MiB."""


def slack(magnitude: ArrayLike) -> Array:
    """How far apart numbers are that tie, of the shape of what they were computed from: ``1e-12 + 1e-9 s``."""
    return np.asarray(TIE + RELATIVE_TIE * np.abs(np.asarray(magnitude, np.float64)))


class Counts(Protocol):
    """A matrix of whole numbers ``[R, N]`` that is known by its products with values ``[N, K]``.

    Where the values are multiples of a power of two of which all partial sums are exact, so are the products.
    """

    @property
    def largest(self) -> float:
        """Magnitude of the largest number, at least 1."""

    def __matmul__(self, values: Array) -> Array: ...


class WholeNumbers(NamedTuple):
    """A matrix ``[R, N]`` of any type of numbers, multiplied in float64 with a part of its rows at a time."""

    values: NDArray[Any]

    @property
    def largest(self) -> float:
        """Magnitude of the largest number, at least 1."""
        return max(1.0, float(self.values.max(initial=0)), -float(self.values.min(initial=0)))

    def __matmul__(self, values: Array) -> Array:
        at_once = max(1, _MAX_CELLS // max(1, self.values.shape[1]))
        parts = [self.values[first : first + at_once] for first in range(0, len(self.values), at_once)]
        found = [part.astype(np.float64, copy=False) @ values for part in parts]
        return np.concatenate([np.empty((0, values.shape[1])), *found])


def sums(counts: NDArray[Any] | Counts, values: Array) -> Array:
    """``sum_g c_g v_g`` for whole numbers ``[R, N]`` and values ``[N, K]`` up to 1e290: ``[R, K]``, rounded once.

    Whole numbers may be of any type; small ones of many rows are best left in a small one.
    """
    matrix = WholeNumbers(counts) if isinstance(counts, np.ndarray) else counts
    num_columns, terms = values.shape[1], matrix.largest * len(values)
    high = _multiples(values, terms)
    both = matrix @ np.concatenate([high, _multiples(values - high, terms)], axis=1)
    return np.asarray(both[:, :num_columns] + both[:, num_columns:])


def _multiples(values: Array, terms: float) -> Array:
    """Values ``[N, K]`` as multiples of a power of two for each column; sums of `terms` of them are exact."""
    exponent = np.frexp(terms * np.abs(values).max(axis=0, initial=0.0))[1] - _DIGITS
    return np.asarray(np.ldexp(np.rint(np.ldexp(values, -exponent)), exponent))


def number(value: float | None) -> float | None:
    """A finite number, or ``None``."""
    return None if value is None or not math.isfinite(value) else float(value)


def numbers(values: Iterable[float]) -> list[float | None]:
    """Finite numbers, ``None`` for others."""
    return [number(value) for value in values]
