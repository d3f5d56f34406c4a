"""Spearman's correlation of many variables with one target, where not every group has a value of it.

Ties stand at their mean rank; a group counts as often as it has a value.

Source: Spearman 1904; spec/13-leakage.md#structural.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["centred_ranks", "places_of", "spearman"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]


_RANKS_AT_ONCE = 1 << 20
"""Ranks that are computed at once: 8 MiB per intermediate array."""


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
    (own,) = _mean_ranks(np.unique(values, return_inverse=True)[1][None], np.ones(len(values)))
    centred[there] = own - own.mean()
    spread = spreads * np.sqrt(np.square(centred).sum())
    shared = (ranks * centred.sum(axis=1)).sum(axis=1)
    return np.asarray(np.divide(shared, spread, out=np.zeros(len(ranks)), where=spread > 0))


def places_of(variables: Array) -> Index:
    """Place of each group among the distinct values of a variable ``[variables, groups]``.

    Args:
        variables: ``[groups, variables]``.
    """
    places = [np.unique(values, return_inverse=True)[1] for values in variables.T]
    return np.array(places, np.int64).reshape(variables.shape[::-1])


def centred_ranks(places: Index, weight: Array) -> tuple[Array, Array]:
    """Ranks of variables about their mean ``[variables, groups]`` and their spreads ``[variables]``.

    Args:
        places: Of every variable, the place of each group among the distinct values ``[variables, groups]``.
        weight: How often each group counts ``[groups]``.
    """
    at_once = max(1, _RANKS_AT_ONCE // max(1, len(weight)))
    parts = [_mean_ranks(places[start : start + at_once], weight) for start in range(0, len(places), at_once)]
    ranks = np.concatenate([np.zeros((0, len(weight))), *parts])
    total = weight.sum()
    if total > 0:
        ranks -= (ranks * weight).sum(axis=1, keepdims=True) / total
    return ranks, np.sqrt((weight * np.square(ranks)).sum(axis=1))


def _mean_ranks(places: Index, weight: Array) -> Array:
    """Mean ranks of values of variables, which count `weight` times, by their places ``[variables, groups]``."""
    num_places = places.max(initial=-1) + 1
    cells = (places + num_places * np.arange(len(places))[:, None]).ravel()
    mass = np.bincount(cells, np.tile(weight, len(places)), len(places) * num_places).reshape(len(places), num_places)
    mean_ranks = np.cumsum(mass, axis=1) - mass + (mass + 1) / 2
    return np.asarray(mean_ranks.ravel()[cells].reshape(places.shape))
