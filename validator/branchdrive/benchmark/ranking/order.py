"""How well scores order the candidates of a group: concordance and NDCG, one number for every group.

With executed utilities ``u`` and scores ``s`` of the ``A`` candidates::

    concordance = mean over pairs |u_i - u_j| > TIE of  1, 1/2 or 0   as s orders the pair right, ties it or wrong
    NDCG        = DCG(s) / DCG(u),      DCG(s) = sum_r u_(r) / log2(1 + r),  r = 1 .. A

Tied scores share the mean discount of their places, which is the expectation over their orders. Scores
tie within `TIE`; for NDCG a chain of them is one tie.

Source: paper VI-D names the measures; pairs of ties and the linear gain follow from the rows it prints.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.utility import RANGE, TIE

__all__ = ["concordance", "ndcg"]

Array = NDArray[np.float64]


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
