"""Cross-fitted ridge from columns to actions: sees leaks that a linear model can learn and carry over.

Columns ``z`` and one-hot actions ``y`` are centred within groups. Fold ``k`` is a run of consecutive groups;
with Gram matrix ``C`` and sums ``S_a`` of centred rows by action, ``-k`` all groups but fold ``k``, ``d`` columns::

    W_k = (C_{-k} + lambda_k I)^{-1} S_{-k}              lambda_k = penalty trace(C_{-k}) / d
    T   = sum_k sum_a S_{k,a} . W_{k,a} / sum |y|^2      sum |y|^2 = groups (actions - 1)

``T`` is the score of held-out rows at their own action, and 0 in expectation where nothing leaks. Gram
matrices do not depend on labels, so that a permutation costs sums alone.

Source: this project's choice.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from branchdrive.leakage.table import Table

__all__ = ["Ridge"]

Array = NDArray[np.float64]
Steps = NDArray[np.float32]


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
            held = groups[start:stop].astype(np.float64)
            centre = held.mean(axis=1, keepdims=True)
            means.append(centre.sum(axis=(0, 1)))
            held = (held - centre).reshape(-1, num_columns)
            grams.append(held.T @ held)
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
        folds = list(pairwise(self.bounds))
        sums = np.empty((len(folds), len(labels), self.steps.shape[1]))
        for fold, (start, stop) in enumerate(folds):
            np.subtract(labels[:, start:stop] @ self.steps[start:stop], self.mean[fold], out=sums[fold])
        whole = sums.sum(axis=0)
        score = np.zeros(len(labels))
        for held, solver in zip(sums, self.solvers, strict=True):
            score += np.einsum("rc,rc->r", (whole - held) @ solver, held)
        num_groups = self.bounds[-1] // self.num_actions
        return np.asarray(score.reshape(-1, self.num_actions).sum(axis=1) / (num_groups * (self.num_actions - 1)))
