"""Spearman's correlation of many variables with one target, where not every group has a value of it.

Ties stand at their mean rank; a group counts as often as it has a value.

Source: Spearman 1904; spec/13-leakage.md#structural.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["centred_ranks", "correlations", "counts_of", "places_of", "spearman"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]


_RANKS_AT_ONCE = 1 << 20
"""Ranks that are computed at once: 8 MiB per intermediate array."""

_EXACT = 2.0**53
"""Whole numbers up to which sums of them are exact."""


def spearman(ranks: Array, spreads: Array, y: Array, there: Mask) -> Array:
    """Rank correlation of every variable with the available values of `y`, 0 where one of both is constant.

    Args:
        ranks: Centred ranks of the variables ``[variables, groups]``.
        spreads: Their spreads ``[variables]``.
        y: Values of a target ``[groups, actions]``.
        there: Where they are available ``[groups, actions]``.
    """
    own, spread = centred_ranks(places_of(y.reshape(-1, 1)), there.reshape(-1).astype(np.float64))
    centred = np.where(there, own.reshape(there.shape), 0.0)
    (found,) = correlations(ranks, spreads, centred.sum(axis=1)[None], spread, int(there.sum()))
    return np.asarray(found)


def correlations(ranks: Array, spreads: Array, others: Array, other_spreads: Array, total: int) -> Array:
    """Rank correlation of every variable with other ones ``[others, variables]``, 0 where one of both is constant.

    Centred ranks are halves of whole numbers, so that sums over not too many groups are exact in any order.

    Args:
        ranks: Centred ranks of the variables ``[variables, groups]``.
        spreads: Their spreads ``[variables]``.
        others: Centred ranks of others, or sums of them, 0 where a group has no value ``[others, groups]``.
        other_spreads: Their spreads ``[others]``.
        total: How often all groups count together.
    """
    at_once = max(1, int(_EXACT / (max(total, 1) * max(4 * np.abs(others).max(initial=1), 1))))
    shared = np.zeros((len(others), len(ranks)))
    for start in range(0, ranks.shape[1], at_once):
        shared += others[:, start : start + at_once] @ ranks[:, start : start + at_once].T
    spread = other_spreads[:, None] * spreads
    return np.divide(shared, spread, out=np.zeros(spread.shape), where=spread > 0)


def places_of(variables: Array) -> Index:
    """Place of each group among the distinct values of a variable ``[variables, groups]``; NaN are one value.

    Args:
        variables: ``[groups, variables]``.
    """
    places = np.zeros(variables.shape[::-1], np.int64)
    at_once = max(1, _RANKS_AT_ONCE // max(1, len(variables)))
    for start in range(0, len(places), at_once):
        values = np.ascontiguousarray(variables[:, start : start + at_once].T)
        order = np.argsort(values, axis=1)
        ordered = np.take_along_axis(values, order, axis=1)
        is_next = (ordered[:, 1:] != ordered[:, :-1]) & ~np.isnan(ordered[:, :-1])
        place = np.zeros(values.shape, np.int64)
        np.cumsum(is_next, axis=1, out=place[:, 1:])
        np.put_along_axis(places[start : start + at_once], order, place, axis=1)
    return places


def counts_of(places: Index, weight: Array) -> tuple[Array, Array]:
    """How often each place counts ``[variables, places]``, and that of each group ``[variables, groups]``.

    Args:
        places: Of every variable, the place of each group among the distinct values ``[variables, groups]``.
        weight: How often each group counts ``[groups]`` or ``[variables, groups]``.
    """
    num_places = places.max(initial=-1) + 1
    cells = places + num_places * np.arange(len(places))[:, None]
    counted = np.bincount(cells.ravel(), np.broadcast_to(weight, cells.shape).ravel(), len(places) * num_places)
    mass = np.asarray(counted, np.float64)  # of nothing, numpy counts in integers
    return mass.reshape(len(places), num_places), mass[cells]


def centred_ranks(places: Index, weight: Array) -> tuple[Array, Array]:
    """Ranks of variables about their mean ``[variables, groups]`` and their spreads ``[variables]``.

    Args:
        places: Of every variable, the place of each group among the distinct values ``[variables, groups]``.
        weight: How often each group counts ``[groups]`` or ``[variables, groups]``.
    """
    weight = np.broadcast_to(weight, places.shape)
    ranks = np.empty(places.shape)
    at_once = max(1, _RANKS_AT_ONCE // max(1, places.shape[1]))
    for start in range(0, len(places), at_once):
        part = slice(start, start + at_once)
        ranks[part] = _mean_ranks(places[part], weight[part])
    ranks -= (ranks * weight).sum(axis=1, keepdims=True) / np.maximum(weight.sum(axis=1, keepdims=True), 1)
    return ranks, np.sqrt((weight * np.square(ranks)).sum(axis=1))


def _mean_ranks(places: Index, weight: Array) -> Array:
    """Mean ranks of values of variables, which count `weight` times, by their places ``[variables, groups]``."""
    mass, _ = counts_of(places, weight)
    mean_ranks = np.cumsum(mass, axis=1) - mass + (mass + 1) / 2
    return np.take_along_axis(mean_ranks, places, axis=1)
