"""Route clusters of groups: the unit of inference where groups of one cluster are alike.

Groups that share a route see the same road, so that their differences between two models are correlated. How much, is
the intra-cluster correlation of a one-way analysis of variance. With ``n_c`` groups of cluster ``c`` that have a
difference, ``n`` in all, ``k`` such clusters, and the means ``m_c`` and ``m``::

    MSB = sum_c n_c (m_c - m)^2 / (k - 1)      MSW = sum_c sum_{g in c} (d_g - m_c)^2 / (n - k)
    n_0 = (n - sum_c n_c^2 / n) / (k - 1)      ICC = (MSB - MSW) / (MSB + (n_0 - 1) MSW)

It is NaN with fewer than two clusters, where no cluster has two groups, and where all differences tie with their mean,
of the magnitude of the largest.

Source: Donner 1986.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from branchdrive.statistics.rounding import slack

__all__ = ["Clusters", "intra_cluster_correlation"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]


class Clusters(NamedTuple):
    """Clusters in the order of their names.

    Attributes:
        names: Names ``[C]``, sorted.
        of_group: Place of the cluster of every group ``[N]``.
    """

    names: tuple[str, ...]
    of_group: Index

    @classmethod
    def of(cls, clusters: Sequence[str]) -> Self:
        """Clusters of the name that each group has ``[N]``."""
        names = tuple(sorted(set(clusters)))
        place = {name: i for i, name in enumerate(names)}
        return cls(names, np.array([place[name] for name in clusters], np.int64))

    def sums(self, values: Array) -> Array:
        """Sums over the groups of each cluster: ``[N, K]`` to ``[C, K]``."""
        found = np.zeros((len(self.names), *values.shape[1:]))
        np.add.at(found, self.of_group, values)
        return found

    def num_there(self, there: Mask) -> NDArray[np.int64]:
        """Clusters that have any group of a mask: ``[N, K]`` to ``[K]``."""
        return np.asarray((self.sums(there.astype(np.float64)) > 0).sum(axis=0), np.int64)


def intra_cluster_correlation(differences: Array, clusters: Clusters) -> Array:
    """Correlation ``[K]`` of differences ``[N, K]`` within clusters; groups with NaN are left out."""
    there = ~np.isnan(differences)
    num = there.sum(axis=0)
    mean = np.where(there, differences, 0.0).sum(axis=0) / np.maximum(num, 1)
    centred = np.where(there, differences - mean, 0.0)
    sizes = clusters.sums(there.astype(np.float64))
    means = clusters.sums(centred) / np.maximum(sizes, 1)
    num_clusters = (sizes > 0).sum(axis=0)
    between = (sizes * means**2).sum(axis=0)
    within = np.where(there, (centred - means[clusters.of_group]) ** 2, 0.0).sum(axis=0)
    largest = np.where(there, np.abs(differences), 0.0).max(axis=0, initial=0.0)
    varies = np.abs(centred).max(axis=0, initial=0.0) > slack(largest)
    defined = (num_clusters > 1) & (num > num_clusters) & varies
    between = between / np.maximum(num_clusters - 1, 1)
    within = within / np.maximum(num - num_clusters, 1)
    size = (num - (sizes**2).sum(axis=0) / np.maximum(num, 1)) / np.maximum(num_clusters - 1, 1)
    above, under = between - within, between + (size - 1) * within
    return np.asarray(np.divide(above, under, out=np.full(len(num), np.nan), where=defined))
