"""Folds over training groups for out-of-fold predictions: a cluster is never on both sides."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from branchdrive.statistics.random_words import words

__all__ = ["NUM_FOLDS", "cluster_folds"]

NUM_FOLDS = 5


def cluster_folds(clusters: Sequence[str], *, seed: int, num_folds: int = NUM_FOLDS) -> NDArray[np.intp]:
    """Fold of every group ``[groups]``, in ``0 .. num_folds - 1``, all groups of a cluster in one.

    Clusters come the larger first, equal ones by the words of the stream ``guard/folds``, one for each cluster in
    the order of their names, and each goes to the fold with the fewest groups, the first of them. The order of the
    groups decides nothing.

    Args:
        clusters: Cluster of every group ``[groups]``.
        seed: In ``[0, 2^64)``.
        num_folds: At least 2.

    Raises:
        ValueError: There are fewer clusters than folds, fewer than two folds, or the seed does not fit 64 bits.
    """
    names, place_of, sizes = np.unique(np.asarray(clusters, np.str_), return_inverse=True, return_counts=True)
    if not 2 <= num_folds <= len(names):
        raise ValueError(f"{len(names)} clusters cannot be parted into {num_folds} folds, at least 2")
    fold_of = np.empty(len(names), np.intp)
    load = np.zeros(num_folds, np.intp)
    drawn = words(seed, "guard/folds", 1, len(names))[0]
    for cluster in np.lexsort((drawn, -sizes)):
        fold_of[cluster] = load.argmin()
        load[fold_of[cluster]] += sizes[cluster]
    return np.asarray(fold_of[place_of])
