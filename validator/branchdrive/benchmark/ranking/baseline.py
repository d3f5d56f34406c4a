"""Estimated utilities of the candidates, by the declared baselines, from training groups alone.

With the utilities ``u_g [A]`` of the ``n`` groups of training in which every candidate has one, their mean ``m``, and
standardised summaries ``z``::

    prior         (sum_{g in cell} u_g + strength m) / (num_g in cell + strength)
    neighbours    mean of u_g over the groups with |z_g - z|^2 at most the k-th smallest one
    ridge         m + z W,     W = (Z'Z + strength n I)^-1 Z'(U - m)

Source: spec/14-benchmark.md#baselines; ridge regression as in Hoerl and Kennard 1970.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.protocol.selection import Baseline, Neighbours, Prior
from branchdrive.benchmark.ranking.context import Contexts, standardised
from branchdrive.statistics.rounding import slack

__all__ = ["estimate", "is_seen", "neighbour_means", "prior_means", "ridge_regression"]

Array = NDArray[np.float64]


def is_seen(baseline: Baseline, contexts: Contexts) -> bool:
    """Whether the dataset has what a baseline sees."""
    return isinstance(baseline, Prior) or contexts.histories[baseline.contract] is not None


def estimate(
    baseline: Baseline, contexts: Contexts, train: Sequence[str], utilities: Array, groups: Sequence[str]
) -> Array:
    """Estimated utilities ``[groups, candidates]``.

    Args:
        baseline: Which.
        contexts: What it sees.
        train: Ids of training groups ``[n]``.
        utilities: Their executed utilities ``[n, candidates]``; a group with a NaN is left out.
        groups: Ids of the groups to estimate.

    Raises:
        ValueError: No training group has all its utilities, or the dataset has not what the baseline sees.
    """
    complete = np.asarray(np.isfinite(utilities).all(axis=1))
    if not complete.any():
        raise ValueError(
            f"none of {len(utilities)} groups has all its utilities; the baseline {baseline.name!r} needs one"
        )
    kept = utilities[complete]
    known = [group for group, is_complete in zip(train, complete.tolist(), strict=True) if is_complete]
    if isinstance(baseline, Prior):
        cells = contexts.cells(baseline.by, known), contexts.cells(baseline.by, groups)
        return prior_means(*cells, kept, strength=baseline.strength)
    fitted, asked = (contexts.history(baseline.contract, some) for some in (known, groups))
    if fitted is None or asked is None:
        raise ValueError(f"the dataset has no evidence of surroundings; the baseline {baseline.name!r} needs it")
    inputs = standardised(fitted, fitted), standardised(fitted, asked)
    if isinstance(baseline, Neighbours):
        return neighbour_means(*inputs, kept, count=int(baseline.neighbours))
    return ridge_regression(*inputs, kept, strength=baseline.strength)


def prior_means(known: Sequence[Hashable], asked: Sequence[Hashable], utilities: Array, *, strength: float) -> Array:
    """Shrunk mean utility of the cell of every asked group ``[asked, candidates]``.

    Args:
        known: Cell of every training group ``[n]``.
        asked: Cell of every asked group.
        utilities: Of the training groups ``[n, candidates]``.
        strength: As how many groups the mean of all counts; more than 0.
    """
    place = {cell: number for number, cell in enumerate(dict.fromkeys(known))}
    homes = np.array([place[cell] for cell in known])
    shared = strength * utilities.mean(axis=0)
    totals = np.zeros((len(place) + 1, utilities.shape[1]))
    np.add.at(totals, homes, utilities)
    counts = np.bincount(homes, minlength=len(totals))[:, None]
    means = (totals + shared) / (counts + strength)
    return np.asarray(means[[place.get(cell, len(place)) for cell in asked]])


def neighbour_means(known: Array, asked: Array, utilities: Array, *, count: int) -> Array:
    """Mean utility of the nearest training groups ``[asked, candidates]``, ties with the last of them among these.

    Args:
        known: Standardised summaries of training groups ``[n, D]``.
        asked: Of the asked groups ``[asked, D]``.
        utilities: Of the training groups ``[n, candidates]``.
        count: How many neighbours, at least 1; all groups where there are fewer.
    """
    found, last = np.empty((len(asked), utilities.shape[1])), min(count, len(known)) - 1
    for row, one in enumerate(asked):
        distance = ((known - one) ** 2).sum(axis=1)
        reach = np.partition(distance, last)[last]
        found[row] = utilities[distance <= reach + slack(reach)].mean(axis=0)
    return found


def ridge_regression(known: Array, asked: Array, utilities: Array, *, strength: float) -> Array:
    """Utilities by ridge regression, one for each candidate ``[asked, candidates]``.

    Args:
        known: Standardised summaries of training groups ``[n, D]``.
        asked: Of the asked groups ``[asked, D]``.
        utilities: Of the training groups ``[n, candidates]``.
        strength: Of the penalty, by training group; more than 0.
    """
    mean = utilities.mean(axis=0)
    gram = known.T @ known + strength * len(known) * np.eye(known.shape[1])
    return np.asarray(mean + asked @ np.linalg.solve(gram, known.T @ (utilities - mean)))
