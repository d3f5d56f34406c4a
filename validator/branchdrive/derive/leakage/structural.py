"""Structural leakage: history variables that rank or repeat a target, and identifiers that tell the partition.

* A variable ranks a target where its Spearman correlation ``|rho| > 0.98``, over every group and available
  candidate, ties at their mean rank; every row of a history is a variable of its own.
* A variable repeats a target where it lies within ``1e-6 (1 + |y|)`` of the target of one action in more
  than half of the groups in which that target is available and differs from 0.
* Identifiers tell the partition where more neighbours in their sorted order share one than in all but
  ``alpha`` of 1,999 permutations, ``p = (1 + #) / 2,000``. The generator is Philox with the key 0.

Source: paper VI-A; spec/13-leakage.md#structural.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["ALPHA", "MAX_CORRELATION", "Telltale", "neighbours_p", "telltales"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_CORRELATION = 0.98
"""Largest correlation of a history variable with a target."""

ALPHA = 0.001
"""Level at which identifiers tell the partition."""

_MAX_REPEATED = 0.5
_SAME = 1e-6
_PERMUTATIONS = 1_999
_MIN_GROUPS = 10
"""Groups below which a rank correlation says nothing."""


class Telltale(NamedTuple):
    """A variable that tells a target: their places, and how."""

    variable: int
    target: int
    how: str


def telltales(variables: Array, targets: Array, available: Mask) -> list[Telltale]:
    """Variables that rank or repeat a target; none are looked for among fewer than ten groups.

    Args:
        variables: ``[groups, variables]``, finite.
        targets: ``[groups, actions, targets]``; any value where not available.
        available: ``[groups, actions, targets]``.
    """
    if len(variables) < _MIN_GROUPS:
        return []
    found = []
    for target in range(targets.shape[2]):
        y, there = targets[..., target], available[..., target]
        rho = _spearman(variables, y, there)
        ranking = np.flatnonzero(np.abs(rho) > MAX_CORRELATION).tolist()
        found += [Telltale(v, target, f"a rank correlation of {rho[v]:.3f}") for v in ranking]
        share = _repeated_share(variables, y, there)
        repeating = np.flatnonzero(share > _MAX_REPEATED).tolist()
        found += [Telltale(v, target, f"its value in {100 * share[v]:.0f} % of the groups") for v in repeating]
    return found


def _spearman(variables: Array, y: Array, there: Mask) -> Array:
    """Rank correlation of every variable with the available values of `y`, 0 where one of both is constant."""
    weight = there.sum(axis=1).astype(np.float64)
    values = y[there]
    if len(values) < 2:
        return np.zeros(variables.shape[1])
    ranks = np.zeros(y.shape)
    ranks[there] = _mean_ranks(values, np.ones(len(values)))
    total = weight.sum()
    centred = np.where(there, ranks - ranks[there].mean(), 0.0)
    of_groups, spread_y = centred.sum(axis=1), np.sqrt(np.square(centred).sum())
    rho = np.zeros(variables.shape[1])
    for i, column in enumerate(variables.T):
        own = _mean_ranks(column, weight)
        own -= (own * weight).sum() / total
        spread = np.sqrt((weight * np.square(own)).sum()) * spread_y
        if spread > 0:
            rho[i] = (own * of_groups).sum() / spread
    return rho


def _mean_ranks(values: Array, weight: Array) -> Array:
    """Mean rank of every value, which counts `weight` times."""
    _, place = np.unique(values, return_inverse=True)
    mass = np.bincount(place, weights=weight)
    return np.asarray((np.cumsum(mass) - mass + (mass + 1) / 2)[place])


def _repeated_share(variables: Array, y: Array, there: Mask) -> Array:
    """Largest share over the actions of the groups whose variable is the target, ``[variables]``."""
    share = np.zeros(variables.shape[1])
    for action in range(y.shape[1]):
        rows = np.flatnonzero(there[:, action] & (y[:, action] != 0))
        if len(rows) >= _MIN_GROUPS:
            wanted = y[rows, action][:, None]
            same = np.abs(variables[rows] - wanted) <= _SAME * (1 + np.abs(wanted))
            share = np.maximum(share, same.mean(axis=0))
    return share


def neighbours_p(homes: Sequence[str]) -> float:
    """Share of permutations in which at least as many neighbours share a partition as here.

    Args:
        homes: Partition of each group, in the order of the sorted identifiers.
    """
    labels = np.unique(np.asarray(homes, np.str_), return_inverse=True)[1]
    observed = int((labels[1:] == labels[:-1]).sum())
    generator = np.random.Generator(np.random.Philox(key=0))
    reached = 0
    for _ in range(_PERMUTATIONS):
        drawn = generator.permutation(labels)
        reached += int((drawn[1:] == drawn[:-1]).sum()) >= observed
    return (1 + reached) / (1 + _PERMUTATIONS)
