"""Spearman's correlation of many variables with one target, where not every group has a value of it.

Ties stand at their mean rank; a group counts as often as it has a value.

Source: Spearman 1904; spec/13-leakage.md#structural.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["centred_ranks", "spearman"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def spearman(ranks: Array, spreads: Array, y: Array, there: Mask) -> Array:
    """Rank correlation of every variable with the available values of `y`, 0 where one of both is constant.

    Args:
        ranks: Centred ranks of the variables ``[variables, groups]``.
        spreads: Their spreads ``[variables]``.
        y: Values of a target ``[groups, actions]``.
        there: Where they are available ``[groups, actions]``.
    """
    values = y[there]
    if len(values) < 2:
        return np.zeros(len(ranks))
    centred = np.zeros(y.shape)
    own = _mean_ranks(np.unique(values, return_inverse=True)[1], np.ones(len(values)))
    centred[there] = own - own.mean()
    spread = spreads * np.sqrt(np.square(centred).sum())
    shared = (ranks * centred.sum(axis=1)).sum(axis=1)
    return np.asarray(np.divide(shared, spread, out=np.zeros(len(ranks)), where=spread > 0))


def centred_ranks(places: Sequence[NDArray[np.intp]], weight: Array) -> tuple[Array, Array]:
    """Ranks of variables about their mean ``[variables, groups]`` and their spreads ``[variables]``.

    Args:
        places: Of every variable, the place of each group among the distinct values ``[groups]``.
        weight: How often each group counts ``[groups]``.
    """
    ranks = np.array([_mean_ranks(place, weight) for place in places]).reshape(len(places), len(weight))
    total = weight.sum()
    if total > 0:
        ranks -= (ranks * weight).sum(axis=1, keepdims=True) / total
    return ranks, np.sqrt((weight * np.square(ranks)).sum(axis=1))


def _mean_ranks(place: NDArray[np.intp], weight: Array) -> Array:
    """Mean rank of every value, which counts `weight` times, by its place among the distinct ones."""
    mass = np.bincount(place, weights=weight)
    return np.asarray((np.cumsum(mass) - mass + (mass + 1) / 2)[place])
