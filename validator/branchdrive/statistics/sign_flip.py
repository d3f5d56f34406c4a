"""Paired tests between models: joint sign flips of groups or of clusters, and a studentised bootstrap beside them.

For differences ``d_g`` of two models over the ``n`` groups that have one, random signs ``s`` shared by all tests, and
``F`` flips::

    T = mean_g d_g        T* = mean_g s_g d_g        p = (1 + #{|T*| >= |T|}) / (F + 1)

With clusters as the unit, all groups of a cluster take one sign::

    T* = mean_g s_c(g) d_g

Flips of groups take the groups as independent; where those of a cluster are correlated they reject too often. Both
test that the differences of their units are symmetric about 0; where they are skewed they reject too often. Dividing
by the standard error would change nothing: a flip keeps ``sum_g d_g^2``, so ``|t*|`` rises with ``|T*|`` and the
p-value is the same. What does not assume symmetry is the bootstrap of ``t``, with the counts ``c`` of resample ``b``
of groups::

    m* = sum c d / sum c      s*^2 = sum c d^2 / sum c - m*^2      t* = (m* - T) / s*      t = T / s
    p = (1 + #{|t*| >= |t|}) / (B + 1)

``|T*|`` reaches ``|T|`` where they tie, of the magnitude ``mean_g |d_g|``; ``|t*| >= |t|`` is ``|m* - T| s >= |T| s*``
but for ``1e-9 mean_g d_g^2``, and ``s*^2`` is 0 where it is at most ``1e-9 sum c (d - T)^2 / sum c``.

Source: Phipson and Smyth 2010 (p-value); Hall and Wilson 1991 (centred, studentised bootstrap test).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.statistics.cluster import Clusters
from branchdrive.statistics.random_words import bits, words
from branchdrive.statistics.rounding import RELATIVE_TIE, slack, sums

__all__ = ["CLUSTER_STREAM", "NUM_FLIPS", "SignFlip", "draw_signs", "p_text", "sign_flip", "studentised_p"]

Array = NDArray[np.float64]
Signs = NDArray[np.int8]

NUM_FLIPS = 10_000
STREAM = "metric/sign-flip"
CLUSTER_STREAM = "metric/sign-flip/clusters"


class SignFlip(NamedTuple):
    """Sign-flip tests, every field ``[K]``.

    Attributes:
        mean: ``T``; NaN where no group has a difference.
        p: Two-sided p-value; 1 where no group has a difference.
        is_smallest: Whether no flip reached ``T``: the p-value is a bound, printed with "<=".
        num_units: Groups, or clusters, that have a difference.
    """

    mean: Array
    p: Array
    is_smallest: NDArray[np.bool_]
    num_units: NDArray[np.int64]


def draw_signs(num_units: int, *, seed: int, num_flips: int = NUM_FLIPS, stream: str = STREAM) -> Signs:
    """Signs int8 ``[num_flips, num_units]`` of +1 and -1 for units in a fixed order, that of their ids or names."""
    signs = bits(words(seed, stream, num_flips, -(-num_units // 64)), num_units).view(np.int8)
    signs *= -2
    signs += 1
    return signs


def sign_flip(differences: Array, signs: Signs | Array, clusters: Clusters | None = None) -> SignFlip:
    """Tests of differences ``[N, K]``, NaN where a group has none, under shared signs.

    Args:
        differences: ``[N, K]``.
        signs: ``[F, N]``, or ``[F, C]`` with clusters.
        clusters: The units; the groups by default.

    Raises:
        ValueError: Shapes do not match.
    """
    num_units = len(differences) if clusters is None else len(clusters.names)
    if differences.ndim != 2 or signs.shape[1:] != (num_units,):
        raise ValueError(
            f"differences {list(differences.shape)} and signs {list(signs.shape)} do not match: [N, K] and [F, N]"
        )
    there = ~np.isnan(differences)
    num_groups = there.sum(axis=0)
    values = np.where(there, differences, 0.0) / np.maximum(num_groups, 1)
    units, there_units = (
        (values, num_groups) if clusters is None else (clusters.sums(values), clusters.num_there(there))
    )
    mean = sums(np.ones((1, num_units)), units)[0]
    reached = np.count_nonzero(np.abs(sums(signs, units)) >= np.abs(mean) - slack(np.abs(values).sum(axis=0)), axis=0)
    p = (1 + reached) / (len(signs) + 1)
    return SignFlip(np.where(num_groups > 0, mean, np.nan), p, reached == 0, there_units)


def studentised_p(differences: Array, counts: NDArray[Any]) -> Array:
    """Studentised bootstrap p-values ``[K]`` of differences ``[N, K]``, with the counts ``[B, N]`` of resamples.

    A resample whose differences are all equal, or that has none, counts as one that reaches ``t``.
    """
    there = ~np.isnan(differences)
    num_groups = there.sum(axis=0)
    values = np.where(there, differences, 0.0)
    mean = values.sum(axis=0) / np.maximum(num_groups, 1)
    centred = np.where(there, differences - mean, 0.0)
    moments = sums(counts, np.concatenate([centred, centred**2, there.astype(np.float64)], axis=1))
    shift, square, total = np.split(moments, 3, axis=1)
    shift, square = (np.divide(part, total, out=np.zeros_like(total), where=total > 0) for part in (shift, square))
    variance = (centred**2).sum(axis=0) / np.maximum(num_groups, 1)
    # |t*| >= |t| without a division; equal values leave a variance of rounding only.
    spread = np.where(square - shift**2 > RELATIVE_TIE * square, square - shift**2, 0.0)
    tie = RELATIVE_TIE * (variance + mean**2)
    reaches = np.abs(shift) * np.sqrt(variance) >= np.abs(mean) * np.sqrt(spread) - tie
    return np.asarray((1 + np.count_nonzero(reaches, axis=0)) / (len(counts) + 1))


def p_text(p: float, is_smallest: bool) -> str:
    """A p-value with two digits; the smallest that the flips allow is a bound and never 0."""
    return f"<= {p:.2g}" if is_smallest else f"{p:.2g}"
