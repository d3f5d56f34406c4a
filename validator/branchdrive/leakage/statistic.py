"""Three forms of statistics of a leakage audit on its table: each sees what another misses.

Each is made ready on a table once and then called with any labels ``[permutations * actions, groups * actions]``.

**Largest standardised mean of an action** sees few strong leaks, and names them. For a table ``z`` of columns, with
group mean ``m_g`` and the sum ``S_a = sum_g z_{g,a}`` of an action::

    t_{a,c} = sum_g (z_{g,a,c} - m_{g,c}) / sqrt(sum_g v_{g,c})        v_{g,c} = mean_a (z_{g,a,c} - m_{g,c})^2
    T       = max_{a,c} |t_{a,c}|

``v_g`` is the exact variance of one term under permutations within groups. `max_t` runs over the values,
`rank_max_t` over centred ranks within groups, which no outlier moves.

**Dependence of features and action by a kernel** sees weak leaks spread over many columns and actions. It is the
Hilbert-Schmidt independence criterion of a Gaussian kernel on columns and the identity on actions, both
centred within groups, with random Fourier features of ``R`` frequencies ``w_r``, nearly normal variates by ``sigma``::

    phi(z) = (cos(w_r . z), sin(w_r . z))_{r = 1 .. R} / sqrt(R)     E phi(z) . phi(z') ~ exp(-|z - z'|^2 / (2 sigma^2))
    T      = sum_a |sum_g (phi(z_{g,a}) - mean_a' phi(z_{g,a'}))|^2 / n^2               n = groups * actions

The bandwidth ``sigma`` is the median of the positive distances between rows of one group. Variates are multiples of
``2^-16`` and columns whole steps, so ``sigma w_r . z`` is exact in float64 in any order; cosine and sine follow from
it by arithmetic that every processor rounds alike, and are rounded to whole steps.

**Cross-fitted ridge from columns to actions** sees leaks that a linear model can learn and carry over.
Columns ``z`` and one-hot actions ``y`` are centred within groups. Fold ``k`` is a run of consecutive groups;
with Gram matrix ``C`` and sums ``S_a`` of centred rows by action, ``-k`` all groups but fold ``k``, ``d`` columns::

    W_k = (C_{-k} + lambda_k I)^{-1} S_{-k}              lambda_k = penalty trace(C_{-k}) / d
    T   = sum_k sum_a S_{k,a} . W_{k,a} / sum |y|^2      sum |y|^2 = groups (actions - 1)

``T`` is the score of held-out rows at their own action, and 0 in expectation where nothing leaks. Gram
matrices do not depend on labels, so that a permutation costs sums alone.

Source: Westfall and Young 1993 (maximum over a family, whose null distribution adjusts every member); Gretton et al.
2008 (criterion); Rahimi and Recht 2007 (features); the ridge is this project's choice.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.angle import cos_sin
from branchdrive.leakage.table import Table, step_limit
from branchdrive.statistics.random_words import WORDS_PER_NORMAL, normals, words

__all__ = ["Hsic", "MaxT", "Ridge", "frequencies", "median_distance"]

Array = NDArray[np.float64]
Steps = NDArray[np.float32]

_FREQUENCIES = "leakage/frequencies"


@dataclass(frozen=True, eq=False)
class MaxT:
    """Largest standardised mean over actions and columns.

    Attributes:
        steps: Whole numbers ``[groups * actions, columns]``.
        num_actions: Actions of a group.
        mean: Expected sum of an action ``[columns]``, in steps.
        inverse_sd: One over the standard deviation of that sum ``[columns]``; 0 where it does not vary.
    """

    steps: Steps
    num_actions: int
    mean: Array
    inverse_sd: Array

    @classmethod
    def of(cls, steps: Steps, num_actions: int) -> MaxT:
        """Statistic of a table ``[groups * actions, columns]``."""
        groups = steps.reshape(len(steps) // num_actions, num_actions, steps.shape[1])
        mean = groups.mean(axis=1, dtype=np.float64)
        square = np.einsum("gac,gac->gc", groups, groups, dtype=np.float64) / num_actions
        variance = np.maximum(square - mean**2, 0.0).sum(axis=0)
        varies = variance > 0
        inverse_sd = np.divide(1.0, np.sqrt(variance), out=np.zeros_like(variance), where=varies)
        return cls(steps, num_actions, mean.sum(axis=0), inverse_sd)

    @property
    def scratch_columns(self) -> int:
        """Float64 numbers that a permutation needs for every action."""
        return 2 * int(self.steps.shape[1])

    def scores(self, labels: NDArray[np.float32]) -> Array:
        """``t`` of labels ``[permutations * actions, groups * actions]``: ``[permutations, actions, columns]``."""
        return self._standardised(labels @ self.steps)

    def __call__(self, labels: NDArray[np.float32]) -> Array:
        """``T`` of every permutation, ``[permutations]``."""
        return self.largest(labels @ self.steps)

    def largest(self, sums: NDArray[np.floating[Any]]) -> Array:
        """``T`` of every permutation from its sums, ``labels @ steps``."""
        scores = self._standardised(sums)
        return np.asarray(np.maximum(scores.max(axis=(1, 2), initial=0.0), -scores.min(axis=(1, 2), initial=0.0)))

    def _standardised(self, sums: NDArray[np.floating[Any]]) -> Array:
        scores = sums.astype(np.float64)
        scores -= self.mean
        scores *= self.inverse_sd
        return np.asarray(scores.reshape(len(scores) // self.num_actions, self.num_actions, self.steps.shape[1]))


def median_distance(values: Array, *, unit: float = 1.0) -> float:
    """Median of the positive distances between rows of one group, 1 where no two rows differ.

    Args:
        values: ``[groups, rows, columns]``; of whole numbers, squares are exact in any order of summation.
        unit: What a value of 1 stands for.
    """
    square = np.einsum("gac,gac->ga", values, values)
    distance = square[:, :, None] + square[:, None, :] - 2 * values @ values.transpose(0, 2, 1)
    first, second = np.triu_indices(values.shape[1], 1)
    distances = distance[:, first, second]
    distances = distances[distances > 1e-12 * max(square.max(initial=0.0), 1e-300)]
    return float(np.sqrt(np.median(distances)) * unit) if distances.size else 1.0


def frequencies(num_columns: int, num_frequencies: int, *, seed: int) -> Array:
    """Random frequencies ``[columns, frequencies]`` of a kernel of bandwidth 1: multiples of ``2^-16``, up to 6."""
    return normals(words(seed, _FREQUENCIES, num_columns, WORDS_PER_NORMAL * num_frequencies))


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


@dataclass(frozen=True, eq=False)
class Ridge:
    """Held-out score of a ridge from columns to actions.

    Attributes:
        steps: Whole numbers ``[groups * actions, columns]``.
        num_actions: Actions of a group.
        bounds: First row of every fold, and the number of rows, ``[folds + 1]``.
        mean: Expected sum of an action in a fold ``[folds, columns]``, in steps.
        solvers: ``(C_{-k} + lambda_k I)^{-1}``, ``[folds, columns, columns]``, in squared steps.
    """

    steps: Steps
    num_actions: int
    bounds: tuple[int, ...]
    mean: Array
    solvers: Array

    @classmethod
    def of(cls, table: Table, num_folds: int, penalty: float) -> Ridge:
        """Statistic of a table with `num_folds` folds, their sizes as equal as possible, larger ones first.

        Raises:
            ValueError: There are fewer groups than folds.
        """
        if table.num_groups < num_folds:
            raise ValueError(f"{table.num_groups} groups cannot fill {num_folds} folds")
        num_actions, num_columns = table.num_actions, table.steps.shape[1]
        small, larger = divmod(table.num_groups, num_folds)
        edges = [fold * small + min(fold, larger) for fold in range(num_folds + 1)]
        groups = table.steps.reshape(table.num_groups, num_actions, num_columns)
        means, grams = [], []
        for start, stop in pairwise(edges):
            rows = groups[start:stop].astype(np.float64)
            centre = rows.mean(axis=1, keepdims=True)
            means.append(centre.sum(axis=(0, 1)))
            rows = (rows - centre).reshape((stop - start) * num_actions, num_columns)
            grams.append(rows.T @ rows)
        whole = np.sum(grams, axis=0)
        for fold, gram in enumerate(grams):
            trained = whole - gram
            shift = penalty * np.trace(trained) / max(num_columns, 1)
            trained[np.diag_indices(num_columns)] += shift or 1.0
            grams[fold] = np.linalg.inv(trained)
        bounds = tuple(edge * num_actions for edge in edges)
        return cls(table.steps, num_actions, bounds, np.array(means), np.array(grams))

    @property
    def scratch_columns(self) -> int:
        """Float64 numbers that a permutation needs for every action."""
        return (len(self.solvers) + 4) * int(self.steps.shape[1])

    def __call__(self, labels: NDArray[np.float32]) -> Array:
        """``T`` of every permutation ``[permutations]``, labels ``[permutations * actions, groups * actions]``."""
        return self.score(self.sums(labels))

    def sums(self, labels: NDArray[np.float32]) -> Array:
        """Sums of each fold ``[folds, permutations * actions, columns]``, in steps; added up, ``labels @ steps``."""
        found = np.empty((len(self.mean), len(labels), self.steps.shape[1]))
        for fold, (start, stop) in enumerate(pairwise(self.bounds)):
            found[fold] = labels[:, start:stop] @ self.steps[start:stop]
        return found

    def score(self, sums: Array) -> Array:
        """``T`` of every permutation from its `sums`, which are centred in place."""
        sums -= self.mean[:, None]
        whole = sums.sum(axis=0)
        score = np.zeros(len(whole))
        for own, solver in zip(sums, self.solvers, strict=True):
            score += np.einsum("rc,rc->r", (whole - own) @ solver, own)
        num_groups = self.bounds[-1] // self.num_actions
        return np.asarray(score.reshape(-1, self.num_actions).sum(axis=1) / (num_groups * (self.num_actions - 1)))
