"""Structural leakage: history variables that rank or hold a target, and identifiers that tell the partition.

* A variable ranks a target where its Spearman correlation ``|rho| > 0.98``, over every group and available
  candidate, ties at their mean rank; every row of a history is a variable of its own.
* A variable holds a target where, for one action, it is an affine function of it at floating-point precision:
  ``1 - r^2 <= 1e-9`` over the groups in which that target is available, with 10 distinct values of both.
* Identifiers tell the partition where more neighbours in their sorted order share one than in all but
  ``alpha`` of 1,999 permutations, ``p = (1 + #) / 2,000``.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage"; spec/13-leakage.md#structural.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.leakage.rank_correlation import centred_ranks, places_of, spearman
from branchdrive.statistics.random_words import orders, words

__all__ = [
    "ALPHA",
    "MAX_CORRELATION",
    "MAX_UNEXPLAINED",
    "TargetLeak",
    "affine_targets",
    "neighbours_p",
    "ranked_targets",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_CORRELATION = 0.98
"""Largest correlation of a history variable with a target."""

ALPHA = 0.001
"""Level at which identifiers tell the partition."""

MAX_UNEXPLAINED = 1e-9
"""Share ``1 - r^2`` of the variance of an affine function that rounding may leave."""

_PERMUTATIONS = 1_999
_PLACES_AT_ONCE = 2**20
_NEIGHBOURS = "leakage/neighbours"
_MIN_GROUPS = 10
"""Groups, or distinct values, below which a correlation says nothing."""


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
    places = places_of(variables)
    ranked: dict[bytes, tuple[Array, Array]] = {}  # most targets are available in the same groups
    found = []
    for target in range(targets.shape[2]):
        weight = available[..., target].sum(axis=1).astype(np.float64)
        if weight.tobytes() not in ranked:
            ranked[weight.tobytes()] = centred_ranks(places, weight)
        rho = spearman(*ranked[weight.tobytes()], targets[..., target], available[..., target])
        ranking = np.flatnonzero(np.abs(rho) > MAX_CORRELATION).tolist()
        found += [TargetLeak(v, target, f"a rank correlation of {rho[v]:.3f}") for v in ranking]
    return found


def affine_targets(
    variables: Array, targets: Array, available: Mask, *, speeds: Sequence[int] = ()
) -> list[TargetLeak]:
    """Variables that are an affine function of a target of one action, each target once.

    A target that a recorded speed holds follows from the motion: whatever holds it then says no more than that speed.

    Args:
        variables: ``[groups, variables]``, finite.
        targets: ``[groups, actions, targets]``; any value where not available.
        available: ``[groups, actions, targets]``.
        speeds: Variables that are the ego's speed at some time.
    """
    found: dict[tuple[int, int], TargetLeak] = {}
    for target in range(targets.shape[2]):
        for action in range(targets.shape[1]):
            there = available[:, action, target]
            is_affine = _is_affine(variables[there], targets[there, action, target])
            if is_affine[list(speeds)].any():
                continue
            for v in np.flatnonzero(is_affine).tolist():
                found.setdefault((target, v), TargetLeak(v, target, f"an affine function, at action {action},"))
    return list(found.values())


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
