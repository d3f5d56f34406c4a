"""Dependence of features and action by a kernel: sees weak leaks spread over many columns and actions.

Hilbert-Schmidt independence criterion of a Gaussian kernel on columns and the identity on actions, both
centred within groups, with random Fourier features of ``R`` frequencies ``w_r``, nearly normal variates by ``sigma``::

    phi(z) = (cos(w_r . z), sin(w_r . z))_{r = 1 .. R} / sqrt(R)     E phi(z) . phi(z') ~ exp(-|z - z'|^2 / (2 sigma^2))
    T      = sum_a |sum_g (phi(z_{g,a}) - mean_a' phi(z_{g,a'}))|^2 / n^2               n = groups * actions

The bandwidth ``sigma`` is the median of the positive distances between rows of one group. Variates are multiples of
``2^-16`` and columns whole steps, so ``sigma w_r . z`` is exact in float64 in any order; cosine and sine follow from
it by arithmetic that every processor rounds alike, and are rounded to whole steps.

Source: Gretton et al. 2008 (criterion); Rahimi and Recht 2007 (features).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.box import cos_sin
from branchdrive.leakage.table import Table, step_limit
from branchdrive.statistics.stream import WORDS_PER_NORMAL, normals, words

__all__ = ["Hsic", "frequencies", "median_distance"]

Array = NDArray[np.float64]
Steps = NDArray[np.float32]

_STREAM = "leakage/frequencies"


def median_distance(values: Array, *, unit: float = 1.0) -> float:
    """Median of the positive distances between rows of one group, 1 where no two rows differ.

    Args:
        values: ``[groups, rows, columns]``; of whole numbers, squares are exact in any order of summation.
        unit: What a value of 1 stands for.
    """
    square = np.einsum("gac,gac->ga", values, values)
    distance = square[:, :, None] + square[:, None, :] - 2 * values @ values.transpose(0, 2, 1)
    first, second = np.triu_indices(values.shape[1], 1)
    apart = distance[:, first, second]
    apart = apart[apart > 1e-12 * max(square.max(initial=0.0), 1e-300)]
    return float(np.sqrt(np.median(apart)) * unit) if apart.size else 1.0


def frequencies(num_columns: int, num_frequencies: int, *, seed: int) -> Array:
    """Random frequencies ``[columns, frequencies]`` of a kernel of bandwidth 1: multiples of ``2^-16``, up to 6."""
    return normals(words(seed, _STREAM, num_columns, WORDS_PER_NORMAL * num_frequencies))


@dataclass(frozen=True, eq=False)
class Hsic:
    """Hilbert-Schmidt independence criterion of columns and actions.

    Attributes:
        steps: Cosines and sines in whole steps, ``[groups * actions, 2 * frequencies]``.
        num_actions: Actions of a group.
        mean: Expected sum of an action ``[2 * frequencies]``, in steps.
        unit: Factor from squared steps to the statistic.
    """

    steps: Steps
    num_actions: int
    mean: Array
    unit: float

    @classmethod
    def of(cls, table: Table, omega: Array, bandwidth: float) -> Hsic:
        """Statistic of a table under frequencies ``[columns, frequencies]`` of bandwidth 1, and a bandwidth."""
        limit = step_limit(table.num_groups)
        angle = (table.steps.astype(np.float64) @ omega) * (table.step / bandwidth)
        steps = np.concatenate([np.rint(part * limit).astype(np.float32) for part in cos_sin(angle)], axis=1)
        mean = steps.sum(axis=0, dtype=np.float64) / table.num_actions
        unit = 1.0 / (omega.shape[1] * float(limit) ** 2 * float(len(steps)) ** 2)
        return cls(steps, table.num_actions, mean, unit)

    @property
    def scratch_columns(self) -> int:
        """Float64 numbers that a permutation needs for every action."""
        return 2 * int(self.steps.shape[1])

    def __call__(self, labels: NDArray[np.float32]) -> Array:
        """``T`` of every permutation ``[permutations]``, labels ``[permutations * actions, groups * actions]``."""
        sums = (labels @ self.steps).astype(np.float64)
        sums -= self.mean
        sums = sums.reshape(-1, self.num_actions * self.steps.shape[1])
        return np.asarray(np.einsum("pk,pk->p", sums, sums) * self.unit)
