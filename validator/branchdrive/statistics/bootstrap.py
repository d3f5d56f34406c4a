"""Bootstrap: how often each group counts in each resample, the same for all models and metrics.

A resample draws ``N`` groups, or the ``C`` route clusters with all their groups, with replacement, so the counts of
its units are multinomial. A metric is a function of counts::

    estimate           all counts 1
    resamples          counts c_1 .. c_B of groups
    jackknife          all counts 1 but that of one group, which is 0
    cluster resamples  counts of clusters, each for all groups of the cluster

and a mean over groups is the ratio of sums ``sum_g c_g a_g / sum_g c_g b_g``, NaN where the lower one is 0. The sums
are rounded once, so that resamples of equal groups have equal metrics.

Source: Efron and Tibshirani 1993; the group is the unit, paper, "Metrics and Statistics"; the cluster is this
project's choice (Field and Welsh 2007).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.statistics.cluster import Clusters
from branchdrive.statistics.random_words import counts as drawn_counts
from branchdrive.statistics.random_words import words
from branchdrive.statistics.rounding import WholeNumbers, sums

__all__ = ["NUM_RESAMPLES", "Design", "counted_mean", "design", "ratio_of_sums", "resampled_counts"]

Array = NDArray[np.float64]

NUM_RESAMPLES = 2000
STREAM = "metric/bootstrap"
CLUSTER_STREAM = "metric/bootstrap/clusters"

_MAX_WORDS = 1 << 20
"""Random words that are drawn at once: 8 MiB."""


@dataclass(frozen=True, eq=False)
class Design:
    """Counts as a matrix ``[1 + B + N + B, N]``: the estimate, resamples, the jackknife, and resamples of clusters.

    It is sliced by rows and multiplied with values, so that the ``N`` times ``N`` counts of the jackknife are never
    all there at once.

    Attributes:
        by_group: Counts of groups in the resamples ``[B, N]``, whole numbers.
        by_cluster: Counts of clusters in theirs ``[B, C]``, whole numbers.
        clusters: Clusters of the groups.
    """

    by_group: NDArray[np.integer]
    by_cluster: NDArray[np.integer]
    clusters: Clusters

    @property
    def num_resamples(self) -> int:
        """``B``."""
        return len(self.by_group)

    @property
    def num_groups(self) -> int:
        """``N``."""
        return len(self.clusters.of_group)

    @cached_property
    def largest(self) -> float:
        """The largest count."""
        return float(max(1, self.by_group.max(), self.by_cluster.max()))

    @property
    def _ends(self) -> tuple[int, int, int]:
        jackknife = 1 + self.num_resamples
        return 1, jackknife, jackknife + self.num_groups

    def __len__(self) -> int:
        return 1 + self.num_resamples + self.num_groups + self.num_resamples

    def __getitem__(self, rows: slice) -> Array:
        """Counts ``[rows, N]``."""
        chosen = np.arange(len(self))[rows]
        _, of_group, of_jackknife, of_cluster = np.split(chosen, np.searchsorted(chosen, self._ends))
        counts = np.ones((len(chosen), self.num_groups))
        first, second, third = self._ends
        counts[np.isin(chosen, of_group)] = self.by_group[of_group - first]
        counts[np.flatnonzero(np.isin(chosen, of_jackknife)), of_jackknife - second] = 0.0
        counts[np.isin(chosen, of_cluster)] = self.by_cluster[of_cluster - third][:, self.clusters.of_group]
        return counts

    def __matmul__(self, values: Array) -> Array:
        """Sums ``[1 + B + N + B, K]`` of values ``[N, K]``; those of the jackknife are ``sum_h v_h - v_g``."""
        total = values.sum(axis=0, keepdims=True)
        by_cluster = WholeNumbers(self.by_cluster) @ self.clusters.sums(values)
        return np.concatenate([total, WholeNumbers(self.by_group) @ values, total - values, by_cluster])

    def split(self, values: Array) -> tuple[Array, Array, Array, Array]:
        """Values ``[1 + B + N + B, ..]`` of a metric by part of the counts.

        Returns:
            Estimate ``[..]``, resamples ``[B, ..]``, jackknife ``[N, ..]``, resamples of clusters ``[B, ..]``.
        """
        estimate, resamples, jackknife, by_cluster = np.split(values, self._ends)
        return estimate[0], resamples, jackknife, by_cluster


def design(clusters: Sequence[str], *, seed: int, num_resamples: int = NUM_RESAMPLES) -> Design:
    """Counts for groups in a fixed order, that of their ids, with the name of the cluster of each ``[N]``.

    Raises:
        ValueError: There is no group, or the seed does not fit.
    """
    found = Clusters.of(clusters)
    by_group = resampled_counts(len(clusters), seed=seed, stream=STREAM, num_resamples=num_resamples)
    by_cluster = resampled_counts(len(found.names), seed=seed, stream=CLUSTER_STREAM, num_resamples=num_resamples)
    return Design(by_group, by_cluster, found)


def resampled_counts(
    num_units: int, *, seed: int, stream: str, num_resamples: int = NUM_RESAMPLES
) -> NDArray[np.unsignedinteger[Any]]:
    """How often each of `num_units` groups or clusters, in a fixed order, is drawn: ``[B, units]`` of the stream.

    Counts are of the smallest type that holds them all, which is uint8 but for a draw that is hardly one.

    Raises:
        ValueError: There is no unit, or the seed does not fit.
    """
    if num_units < 1:
        raise ValueError("a bootstrap needs at least one group")
    at_once = max(1, _MAX_WORDS // num_units)
    parts = []
    for first in range(0, num_resamples, at_once):
        num_rows = min(at_once, num_resamples - first)
        found = drawn_counts(words(seed, stream, num_rows, num_units, first_row=first), num_units)
        parts.append(found.astype(np.min_scalar_type(int(found.max()))))
    return np.concatenate(parts)


def ratio_of_sums(counts: Array | Design, numerators: Array, denominators: Array) -> Array:
    """``sum_g c_g a_g / sum_g c_g b_g`` for counts ``[R, N]`` and two ``[N, K]``: ``[R, K]``."""
    above, under = np.split(sums(counts, np.concatenate([numerators, denominators], axis=1)), 2, axis=1)
    return np.asarray(np.divide(above, under, out=np.full(above.shape, np.nan), where=under > 0))


def counted_mean(counts: Array | Design, values: Array) -> Array:
    """Mean over the groups that have a value: counts ``[R, N]``, values ``[N, K]`` with NaN for none: ``[R, K]``."""
    there = ~np.isnan(values)
    return ratio_of_sums(counts, np.where(there, values, 0.0), there.astype(np.float64))
