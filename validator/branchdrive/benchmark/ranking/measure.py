"""Selectors and what their choices are worth: shares of candidates, and measures, one number for every group.

A selector has scores ``s`` and shares ``w``, the shares of a group adding up to 1::

    outcome-derived, oracle   s = utility, predicted or executed     w = one at the first candidate of the best score
    fixed, Nominal            s = w = one at one candidate
    Random                    s = 0                                  w = 1 / A

Scores within `TIE` of the best are equally good, and the first of them in canonical order is taken. With executed
utilities ``u`` of the ``A`` candidates, best and worst of the group among them::

    value = sum_a w_a u_a        difference = value - u_nominal        top 1 = sum of w_a where u_a >= best - TIE
    regret = (best - value) / (best - worst)                           0 where best - worst <= RANGE
    concordance = mean over pairs |u_i - u_j| > TIE of  1, 1/2 or 0    as s orders the pair right, ties it or wrong
    NDCG        = DCG(s) / DCG(u),      DCG(s) = sum_r u_(r) / log2(1 + r),  r = 1 .. A

Tied scores share the mean discount of their places, which is the expectation over their orders. Scores
tie within `TIE`; for NDCG a chain of them is one tie. Rows of a learned selector are means of its per-seed measures.

Source: paper, "Complete-Bank Ranking and Offline Policy Evaluation", table of offline policy evaluation, which names
the measures. Pairs of ties and the linear gain follow from the rows it prints; a uniform random choice stands for
itself by its expectation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.utility import RANGE, TIE

__all__ = [
    "Measures",
    "Selector",
    "best_fixed",
    "by_score",
    "choose",
    "concordance",
    "fixed",
    "mean_measures",
    "measures",
    "ndcg",
    "uniform",
    "without_range",
]

Array = NDArray[np.float64]


class Measures(NamedTuple):
    """Measures of one selector, each ``[groups]``; a table prints their means, a test compares them by group.

    Attributes:
        value: Executed utility of the choice.
        difference: Value minus the nominal candidate's utility.
        regret: In ``[0, 1]``, 0 the best.
        concordance: In ``[0, 1]``; NaN where all utilities are equal.
        ndcg: In ``[0, 1]``.
        top_1: Share of the choice that is as good as the best.
    """

    value: Array
    difference: Array
    regret: Array
    concordance: Array
    ndcg: Array
    top_1: Array


def measures(selector: Selector, utilities: Array, *, nominal: int) -> Measures:
    """Measures of `selector` on groups with executed `utilities` ``[groups, candidates]``.

    Raises:
        ValueError: Shapes differ, or a utility is not a number; such a group is not ranked.
    """
    if not selector.scores.shape == selector.shares.shape == utilities.shape:
        raise ValueError(
            f"scores {list(selector.scores.shape)}, shares {list(selector.shares.shape)} and utilities "
            f"{list(utilities.shape)} do not match: [groups, candidates]"
        )
    if not np.isfinite(utilities).all():
        raise ValueError("a utility is not a number; leave its group out of the ranking")
    best, worst = utilities.max(axis=1), utilities.min(axis=1)
    value = (selector.shares * utilities).sum(axis=1)
    ranged = best - worst > RANGE
    return Measures(
        value=value,
        difference=value - utilities[:, nominal],
        regret=np.divide(best - value, best - worst, out=np.zeros(len(value)), where=ranged),
        concordance=concordance(selector.scores, utilities),
        ndcg=ndcg(selector.scores, utilities),
        top_1=(selector.shares * (utilities >= best[:, None] - TIE)).sum(axis=1),
    )


def mean_measures(seeds: Sequence[Measures]) -> Measures:
    """Mean over the seeds of a learned selector, group by group."""
    return Measures(*(np.mean(field, axis=0) for field in zip(*seeds, strict=True)))


def without_range(utilities: Array) -> int:
    """Number of groups whose utilities have no range to speak of: their regret counts as 0."""
    return int((utilities.max(axis=1) - utilities.min(axis=1) <= RANGE).sum())


def concordance(scores: Array, utilities: Array) -> Array:
    """Share of pairs in the right order ``[groups]``, both arguments ``[groups, candidates]``; NaN if all are ties."""
    first, second = np.triu_indices(utilities.shape[1], k=1)
    truth, found = (_sign(values[:, first] - values[:, second]) for values in (utilities, scores))
    decided = truth != 0
    num_decided = decided.sum(axis=1)
    right = np.where(decided, (1.0 + truth * found) / 2.0, 0.0).sum(axis=1)
    return np.asarray(np.divide(right, num_decided, out=np.full(len(right), np.nan), where=num_decided > 0))


def ndcg(scores: Array, utilities: Array) -> Array:
    """Normalised discounted cumulative gain ``[groups]``, both arguments ``[groups, candidates]``.

    Where no candidate has a gain above `RANGE`, every order is the best one and the value is 1.

    Raises:
        ValueError: A utility is negative.
    """
    if (utilities < 0).any():
        raise ValueError("a utility is negative; a gain is at least 0")
    ideal = _dcg(utilities, utilities)
    hopeless = utilities.max(axis=1) <= RANGE
    return np.asarray(np.divide(_dcg(scores, utilities), ideal, out=np.ones(len(ideal)), where=~hopeless))


def _dcg(scores: Array, gains: Array) -> Array:
    num_groups, num_candidates = gains.shape
    discount = 1.0 / np.log2(np.arange(2, num_candidates + 2))
    order = np.argsort(-scores, axis=1, kind="stable")
    ranked = np.take_along_axis(scores, order, axis=1)
    opens = np.concatenate((np.zeros((num_groups, 1), np.bool_), ranked[:, :-1] - ranked[:, 1:] > TIE), axis=1)
    place = (np.arange(num_groups)[:, None] * num_candidates + opens.cumsum(axis=1)).reshape(-1)
    shared = np.bincount(place, np.tile(discount, num_groups)) / np.maximum(np.bincount(place), 1)
    return np.asarray((shared[place].reshape(gains.shape) * np.take_along_axis(gains, order, axis=1)).sum(axis=1))


def _sign(difference: Array) -> Array:
    return np.where(np.abs(difference) <= TIE, 0.0, np.sign(difference))


Indices = NDArray[np.intp]


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
    complete = utilities[np.isfinite(utilities).all(axis=1)]
    if not len(complete):
        raise ValueError(f"none of {len(utilities)} groups has all its utilities; a fixed candidate needs one")
    places = list(range(utilities.shape[1])) if among is None else sorted(among)
    if not places:
        raise ValueError("`among` is empty; name the candidates to choose from")
    return places[int(choose(complete.mean(axis=0)[places]))]


def _one_hot(chosen: Indices, num_candidates: int) -> Array:
    return np.asarray(np.arange(num_candidates) == chosen[:, None], np.float64)
