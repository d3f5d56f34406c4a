"""Selectors: what ranks the candidates of a group, and with which share it takes each.

A selector has scores ``s`` and shares ``w``, the shares of a group adding up to 1::

    outcome-derived, oracle   s = utility, predicted or executed     w = one at the first candidate of the best score
    fixed, Nominal            s = w = one at one candidate
    Random                    s = 0                                  w = 1 / A

Scores within `TIE` of the best are equally good, and the first of them in canonical order is taken.

Source: paper VI-D; a uniform random choice stands for itself by its expectation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.utility import TIE

__all__ = ["LEARNED", "Selector", "best_fixed", "by_score", "choose", "fixed", "uniform"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

LEARNED = "O-"
"""Name of an outcome-derived selector, before that of its model."""


class Selector(NamedTuple):
    """Scores and shares of the candidates, each ``[groups, candidates]``."""

    scores: Array
    shares: Array


def choose(scores: Array, tie: float = TIE) -> Indices:
    """First candidate within `tie` of the best score: ``[...]`` from ``[..., candidates]``; ``-inf`` is never taken.

    Raises:
        ValueError: A score is NaN or ``inf``, or a group has no finite score.
    """
    best = scores.max(axis=-1, keepdims=True)
    if not (np.isfinite(best).all() and (scores < np.inf).all()):
        raise ValueError("a choice needs scores that are numbers, and a finite one in every group")
    return np.asarray((scores >= best - tie).argmax(axis=-1))


def by_score(scores: Array) -> Selector:
    """The selector that takes the best score of every group."""
    return Selector(scores, _one_hot(choose(scores), scores.shape[1]))


def fixed(candidate: int, num_groups: int, num_candidates: int) -> Selector:
    """The selector that always takes one candidate, with one-hot scores.

    Raises:
        ValueError: There is no such candidate.
    """
    if not 0 <= candidate < num_candidates:
        raise ValueError(f"candidate {candidate} is not in 0 .. {num_candidates - 1}")
    chosen = _one_hot(np.full(num_groups, candidate), num_candidates)
    return Selector(chosen, chosen)


def uniform(num_groups: int, num_candidates: int) -> Selector:
    """The selector that takes any candidate, as its expectation: equal scores and equal shares."""
    equal = np.zeros((num_groups, num_candidates))
    return Selector(equal, equal + 1.0 / num_candidates)


def best_fixed(utilities: Array, among: Sequence[int] | None = None) -> int:
    """The candidate of the greatest mean utility: ActionPrior on training groups, fixed brake on validation groups.

    Args:
        utilities: Executed utilities ``[groups, candidates]``; a group with a NaN is left out.
        among: Candidates to choose from, ascending; all of them by default. Ties go to the first.

    Raises:
        ValueError: No group has all its utilities, or there is nothing to choose from.
    """
    known = utilities[np.isfinite(utilities).all(axis=1)]
    if not len(known):
        raise ValueError(f"none of {len(utilities)} groups has all its utilities; a fixed candidate needs one")
    places = list(range(utilities.shape[1])) if among is None else sorted(among)
    if not places:
        raise ValueError("`among` is empty; name the candidates to choose from")
    return places[int(choose(known.mean(axis=0)[places]))]


def _one_hot(chosen: Indices, num_candidates: int) -> Array:
    return np.asarray(np.arange(num_candidates) == chosen[:, None], np.float64)
