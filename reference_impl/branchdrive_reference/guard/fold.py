"""Folds over training groups for out-of-fold predictions: a cluster is never on both sides."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["NUM_FOLDS", "cluster_folds"]

NUM_FOLDS = 5


def cluster_folds(clusters: Sequence[str], *, seed: int, num_folds: int = NUM_FOLDS) -> NDArray[np.intp]:
    """Fold of every group ``[groups]``, in ``0 .. num_folds - 1``, all groups of a cluster in one.

    Clusters come in random order, the larger first, and each goes to the fold with the fewest groups. The
    order of the groups decides nothing.

    Args:
        clusters: Cluster of every group ``[groups]``.
        seed: In ``[0, 2^64)``.
        num_folds: At least 2.

    Raises:
        ValueError: There are fewer clusters than folds, fewer than two folds, or the seed does not fit the key.
    """
    names, place_of, sizes = np.unique(np.asarray(clusters, np.str_), return_inverse=True, return_counts=True)
    if not 2 <= num_folds <= len(names):
        raise ValueError(f"{len(names)} clusters cannot be parted into {num_folds} folds, at least 2")
    if not 0 <= seed < 1 << 64:
        raise ValueError(f"`seed` is {seed}, not in [0, 2^64)")
    stream = int.from_bytes(hashlib.sha256(b"guard/folds").digest()[:8], "little")
    words = np.random.Philox(key=np.array([seed, stream], np.uint64)).random_raw(len(names))
    fold_of = np.empty(len(names), np.intp)
    load = np.zeros(num_folds, np.intp)
    for cluster in np.lexsort((words, -sizes)):
        fold_of[cluster] = load.argmin()
        load[fold_of[cluster]] += sizes[cluster]
    return np.asarray(fold_of[place_of])
