"""Largest standardised mean of an action: sees few strong leaks, and names them.

For a table ``z`` of columns, with group mean ``m_g`` and the sum ``S_a = sum_g z_{g,a}`` of an action::

    t_{a,c} = sum_g (z_{g,a,c} - m_{g,c}) / sqrt(sum_g v_{g,c})        v_{g,c} = mean_a (z_{g,a,c} - m_{g,c})^2
    T       = max_{a,c} |t_{a,c}|

``v_g`` is the exact variance of one term under permutations within groups. `max_t` runs over the values,
`rank_max_t` over centred ranks within groups, which no outlier moves.

Source: Westfall and Young 1993 (maximum over a family, whose null distribution adjusts every member).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["MaxT"]

Array = NDArray[np.float64]
Steps = NDArray[np.float32]


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
        groups = steps.reshape(-1, num_actions, steps.shape[1])
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
        scores = (labels @ self.steps).astype(np.float64)
        scores -= self.mean
        scores *= self.inverse_sd
        return np.asarray(scores.reshape(-1, self.num_actions, self.steps.shape[1]))

    def __call__(self, labels: NDArray[np.float32]) -> Array:
        """``T`` of every permutation, ``[permutations]``."""
        scores = self.scores(labels)
        return np.asarray(np.maximum(scores.max(axis=(1, 2)), -scores.min(axis=(1, 2))))
