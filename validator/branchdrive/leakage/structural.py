"""Structural leakage: history variables that rank or hold a target, and identifiers that tell the partition.

* A variable ranks a target where its Spearman correlation ``|rho| > 0.98``, over every group and available
  candidate, ties at their mean rank; every row of a history is a variable of its own.
* A variable holds a target where, for one action, it is an affine function of it at floating-point precision:
  ``1 - r^2 <= 1e-9`` over the groups in which that target is available, with 10 distinct values of both.
* A variable tells an outcome where it ranks a target of one action, or the least, the mean or the largest of a target
  over the actions, with ``|rho| > 0.999``, or the place of the action with the least or the largest, with 0.98; an
  outcome that a speed, or variables of two other columns, rank with 0.99 follows from the motion, and is no secret.
* Identifiers tell the partition where more neighbours in their sorted order share one than in all but
  ``alpha`` of 1,999 permutations, ``p = (1 + #) / 2,000``.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage"; spec/13-leakage.md#structural.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.statistics.stream import orders, words

__all__ = [
    "ALPHA",
    "MAX_CORRELATION",
    "MAX_UNEXPLAINED",
    "TargetLeak",
    "affine_targets",
    "neighbours_p",
    "ranked_targets",
    "revealed_outcomes",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_CORRELATION = 0.98
"""Largest correlation of a history variable with a target."""

MAX_OUTCOME_CORRELATION = 0.999
"""Largest correlation of a history variable with an outcome of one action, or of all: a speed reaches 0.985."""

ALPHA = 0.001
"""Level at which identifiers tell the partition."""

MAX_UNEXPLAINED = 1e-9
"""Share ``1 - r^2`` of the variance of an affine function that rounding may leave."""

_PERMUTATIONS = 1_999
_PLACES_AT_ONCE = 2**20
_NEIGHBOURS = "leakage/neighbours"
_MIN_GROUPS = 10
"""Groups, or distinct values, below which a correlation says nothing."""

_KNOWN_CORRELATION, _NUM_KNOWING = 0.99, 2
"""Correlation with an outcome, and how many other columns must reach it, by which the motion itself tells it."""

_SPEED = "state speed_mps"
"""The column that is enough by itself."""

_MIN_RANKED = 15
"""Groups below which a variable may rank one of many outcomes by chance."""

_MIN_COMMON = 3
"""Values, each of as many groups, that a place among actions and its code need."""


class TargetLeak(NamedTuple):
    """A variable that gives a target away: their places, and how."""

    variable: int
    target: int
    how: str


def ranked_targets(variables: Array, targets: Array, available: Mask) -> list[TargetLeak]:
    """Variables that rank a target; none are looked for among fewer than ten groups.

    Args:
        variables: ``[groups, variables]``, finite.
        targets: ``[groups, actions, targets]``; any value where not available.
        available: ``[groups, actions, targets]``.
    """
    if len(variables) < _MIN_GROUPS:
        return []
    places = [np.unique(column, return_inverse=True)[1] for column in variables.T]
    ranked: dict[bytes, tuple[Array, Array]] = {}  # most targets are available in the same groups
    found = []
    for target in range(targets.shape[2]):
        weight = available[..., target].sum(axis=1).astype(np.float64)
        if weight.tobytes() not in ranked:
            ranked[weight.tobytes()] = _centred_ranks(places, weight)
        rho = _spearman(*ranked[weight.tobytes()], targets[..., target], available[..., target])
        ranking = np.flatnonzero(np.abs(rho) > MAX_CORRELATION).tolist()
        found += [TargetLeak(v, target, f"a rank correlation of {rho[v]:.3f}") for v in ranking]
    return found


def affine_targets(variables: Array, targets: Array, available: Mask) -> list[TargetLeak]:
    """Variables that are an affine function of a target of one action, each target once.

    Args:
        variables: ``[groups, variables]``, finite.
        targets: ``[groups, actions, targets]``; any value where not available.
        available: ``[groups, actions, targets]``.
    """
    found: dict[tuple[int, int], TargetLeak] = {}
    for target in range(targets.shape[2]):
        for action in range(targets.shape[1]):
            there = available[:, action, target]
            for v in np.flatnonzero(_is_affine(variables[there], targets[there, action, target])).tolist():
                found.setdefault((target, v), TargetLeak(v, target, f"an affine function, at action {action},"))
    return list(found.values())


class _Outcome(NamedTuple):
    """Something that the candidates of a group came to: its name, values and availability ``[groups]``."""

    name: str
    values: Array
    there: Mask
    is_place: bool


def revealed_outcomes(variables: Array, columns: Sequence[str], targets: Array, available: Mask) -> list[TargetLeak]:
    """Variables that rank an outcome, each target once; none are looked for among fewer than fifteen groups.

    Args:
        variables: ``[groups, variables]``, finite.
        columns: The column that each variable is a time of ``[variables]``.
        targets: ``[groups, actions, targets]``; any value where not available.
        available: ``[groups, actions, targets]``.
    """
    if len(variables) < _MIN_RANKED:
        return []
    places = [np.unique(column, return_inverse=True)[1] for column in variables.T]
    ranked: dict[bytes, tuple[Array, Array]] = {}
    found: dict[tuple[int, int], TargetLeak] = {}
    for target in range(targets.shape[2]):
        for outcome in _outcomes(targets[..., target], available[..., target]):
            there = outcome.there if outcome.is_place else _single(outcome.values, outcome.there)
            weight = there.astype(np.float64)
            y = np.where(there, outcome.values, 0.0)
            if weight.sum() < _MIN_RANKED or not _is_rich(y[there], outcome.is_place):
                continue
            if weight.tobytes() not in ranked:
                ranked[weight.tobytes()] = _centred_ranks(places, weight)
            rho = _spearman(*ranked[weight.tobytes()], y[:, None], there[:, None])
            bound = MAX_CORRELATION if outcome.is_place else MAX_OUTCOME_CORRELATION
            knowing = {columns[v] for v in np.flatnonzero(np.abs(rho) > _KNOWN_CORRELATION).tolist()}
            if _SPEED in knowing:
                continue
            for v in np.flatnonzero(np.abs(rho) > bound).tolist():
                is_known = len(knowing - {columns[v]}) >= _NUM_KNOWING
                if not is_known and _is_rich(places[v][there], outcome.is_place):
                    how = f"a rank correlation of {rho[v]:.4f} with {outcome.name}"
                    found.setdefault((target, v), TargetLeak(v, target, how))
    return list(found.values())


def _outcomes(values: Array, there: Mask) -> list[_Outcome]:
    """Outcomes of one target ``[groups, actions]``: of every action, and of all that are available in a group."""
    found = [
        _Outcome(f"the value, at action {action},", values[:, action], there[:, action], False)
        for action in range(values.shape[1])
    ]
    anywhere: Mask = np.asarray(there.any(axis=1))
    count = np.maximum(there.sum(axis=1), 1)
    low, high = np.where(there, values, np.inf), np.where(there, values, -np.inf)
    of_all = {
        "the least value": low.min(axis=1),
        "the mean value": np.where(there, values, 0.0).sum(axis=1) / count,
        "the largest value": high.max(axis=1),
    }
    found += [_Outcome(name, y, anywhere, False) for name, y in of_all.items()]
    places = {"the place of the least value": low.argmin(axis=1), "the place of the largest value": high.argmax(axis=1)}
    for name, y in places.items():
        found.append(_Outcome(name, y.astype(np.float64), anywhere, True))
    return found


def _single(values: Array, there: Mask) -> Mask:
    """Groups whose value no other group has: noise on a copy orders equal ones at random."""
    own = np.flatnonzero(there)
    _, place, count = np.unique(values[own], return_inverse=True, return_counts=True)
    single = np.zeros(len(values), np.bool_)
    single[own[count[place] == 1]] = True
    return single


def _is_rich(values: NDArray[np.generic], is_place: bool) -> bool:
    """Whether values are distinct enough for a correlation to say something."""
    counts = np.unique(values, return_counts=True)[1]
    if is_place:
        return bool((counts >= _MIN_COMMON).sum() >= _MIN_COMMON)
    return len(counts) >= _MIN_GROUPS


def _is_affine(variables: Array, y: Array) -> Mask:
    """Whether a variable is an affine function of ``y`` ``[groups]``, for each ``[variables]``."""
    affine = np.zeros(variables.shape[1], np.bool_)
    if len(np.unique(y)) < _MIN_GROUPS:
        return affine
    centred, signed = variables - variables.mean(axis=0), y - y.mean()
    spread = np.square(centred).sum(axis=0) * np.square(signed).sum()
    with np.errstate(divide="ignore", invalid="ignore"):
        left = 1 - np.square(centred.T @ signed) / spread
    near = np.flatnonzero(left <= MAX_UNEXPLAINED)
    affine[near] = [len(np.unique(variables[:, v])) >= _MIN_GROUPS for v in near.tolist()]
    return affine


def _spearman(ranks: Array, spreads: Array, y: Array, there: Mask) -> Array:
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


def _centred_ranks(places: Sequence[NDArray[np.intp]], weight: Array) -> tuple[Array, Array]:
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


def neighbours_p(homes: Sequence[str]) -> float:
    """Share of permutations in which at least as many neighbours share a partition as here.

    Args:
        homes: Partition of each group, in the order of the sorted identifiers.
    """
    labels = np.unique(np.asarray(homes, np.str_), return_inverse=True)[1]
    observed = int((labels[1:] == labels[:-1]).sum())
    num_rows = max(1, _PLACES_AT_ONCE // len(labels))
    reached = 0
    for start in range(0, _PERMUTATIONS, num_rows):
        num_drawn = min(num_rows, _PERMUTATIONS - start)
        drawn = labels[orders(words(0, _NEIGHBOURS, num_drawn, len(labels), first_row=start))]
        reached += int(np.count_nonzero((drawn[:, 1:] == drawn[:, :-1]).sum(axis=1) >= observed))
    return (1 + reached) / (1 + _PERMUTATIONS)
