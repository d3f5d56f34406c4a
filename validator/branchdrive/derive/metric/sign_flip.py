"""Paired tests between models: joint sign flips of groups, and a studentised bootstrap beside them.

For differences ``d_g`` of two models over the ``n`` groups that have one, random signs ``s`` shared by all tests, and
``F`` flips::

    T = mean_g d_g        T* = mean_g s_g d_g        p = (1 + #{|T*| >= |T| - 1e-12}) / (F + 1)

This tests that the differences are symmetric about 0; where they are skewed it rejects too often. Dividing by the
standard error would change nothing: a flip keeps ``sum_g d_g^2``, so ``|t*|`` rises with ``|T*|`` and the p-value is
the same. What does not assume symmetry is the bootstrap of ``t``, with the counts ``c`` of resample ``b``::

    m* = sum c d / sum c      s*^2 = sum c d^2 / sum c - m*^2      t* = (m* - T) / s*      t = T / s
    p = (1 + #{|t*| >= |t|}) / (B + 1)

Source: Phipson and Smyth 2010 (p-value); Hall and Wilson 1991 (centred, studentised bootstrap test).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.derive.metric.stream import bits, words

__all__ = ["NUM_FLIPS", "SignFlip", "draw_signs", "p_text", "sign_flip", "studentised_p"]

Array = NDArray[np.float64]

NUM_FLIPS = 10_000
TIE = 1e-12
STREAM = "metric/sign-flip"

_RELATIVE_TIE = 1e-9


class SignFlip(NamedTuple):
    """Sign-flip tests, every field ``[K]``.

    Attributes:
        mean: ``T``; NaN where no group has a difference.
        p: Two-sided p-value; 1 where no group has a difference.
        is_smallest: Whether no flip reached ``T``: the p-value is a bound, printed with "<=".
        num_groups: Groups that have a difference.
    """

    mean: Array
    p: Array
    is_smallest: NDArray[np.bool_]
    num_groups: NDArray[np.int64]


def draw_signs(num_groups: int, *, seed: int, num_flips: int = NUM_FLIPS) -> Array:
    """Signs ``[num_flips, num_groups]`` of +1 and -1 for groups in a fixed order, that of their ids."""
    drawn = bits(words(seed, STREAM, num_flips, -(-num_groups // 64)), num_groups)
    return np.asarray(1.0 - 2.0 * drawn, np.float64)


def sign_flip(differences: Array, signs: Array) -> SignFlip:
    """Tests of differences ``[N, K]``, NaN where a group has none, under shared signs ``[F, N]``.

    Raises:
        ValueError: Shapes do not match.
    """
    if differences.ndim != 2 or signs.shape[1:] != differences.shape[:1]:
        raise ValueError(
            f"differences {list(differences.shape)} and signs {list(signs.shape)} do not match: [N, K] and [F, N]"
        )
    there = ~np.isnan(differences)
    num_groups = there.sum(axis=0)
    values = np.where(there, differences, 0.0) / np.maximum(num_groups, 1)
    mean = values.sum(axis=0)
    reached = np.count_nonzero(np.abs(signs @ values) >= np.abs(mean) - TIE, axis=0)
    return SignFlip(np.where(num_groups > 0, mean, np.nan), (1 + reached) / (len(signs) + 1), reached == 0, num_groups)


def studentised_p(differences: Array, counts: Array) -> Array:
    """Studentised bootstrap p-values ``[K]`` of differences ``[N, K]``, with the counts ``[B, N]`` of resamples.

    A resample whose differences are all equal, or that has none, counts as one that reaches ``t``.
    """
    there = ~np.isnan(differences)
    num_groups = there.sum(axis=0)
    values = np.where(there, differences, 0.0)
    mean = values.sum(axis=0) / np.maximum(num_groups, 1)
    centred = np.where(there, differences - mean, 0.0)
    total = counts @ there.astype(np.float64)
    there_is = total > 0
    shift = np.divide(counts @ centred, total, out=np.zeros_like(total), where=there_is)
    square = np.divide(counts @ centred**2, total, out=np.zeros_like(total), where=there_is)
    variance = (centred**2).sum(axis=0) / np.maximum(num_groups, 1)
    # |t*| >= |t| without a division; equal values leave a variance of rounding only.
    spread = np.where(square - shift**2 > _RELATIVE_TIE * square, square - shift**2, 0.0)
    reaches = shift**2 * variance >= mean**2 * spread * (1 - _RELATIVE_TIE)
    return np.asarray((1 + np.count_nonzero(reaches, axis=0)) / (len(counts) + 1))


def p_text(p: float, is_smallest: bool) -> str:
    """A p-value with two digits; the smallest that the flips allow is a bound and never 0."""
    return f"<= {p:.2g}" if is_smallest else f"{p:.2g}"
