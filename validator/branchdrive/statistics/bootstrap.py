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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.statistics.cluster import Clusters
from branchdrive.statistics.random_words import below, words
from branchdrive.statistics.rounding import sums

__all__ = ["NUM_RESAMPLES", "Design", "counted_mean", "design", "ratio_of_sums", "resampled_counts"]

Array = NDArray[np.float64]

NUM_RESAMPLES = 2000
STREAM = "metric/bootstrap"
CLUSTER_STREAM = "metric/bootstrap/clusters"


class Design(NamedTuple):
    """Counts ``[1 + B + N + B, N]``: the estimate, `num_resamples` resamples, the jackknife, resamples of clusters."""

    counts: Array
    num_resamples: int
    clusters: Clusters

    def split(self, values: Array) -> tuple[Array, Array, Array, Array]:
        """Values ``[1 + B + N + B, ..]`` of a metric by part of the counts.

        Returns:
            Estimate ``[..]``, resamples ``[B, ..]``, jackknife ``[N, ..]``, resamples of clusters ``[B, ..]``.
        """
        ends = np.cumsum([1, self.num_resamples, self.counts.shape[1]])
        estimate, resamples, jackknife, by_cluster = np.split(values, ends)
        return estimate[0], resamples, jackknife, by_cluster


def design(clusters: Sequence[str], *, seed: int, num_resamples: int = NUM_RESAMPLES) -> Design:
    """Counts for groups in a fixed order, that of their ids, with the name of the cluster of each ``[N]``.

    Raises:
        ValueError: There is no group, or the seed does not fit.
    """
    num_groups, found = len(clusters), Clusters.of(clusters)
    by_group = resampled_counts(num_groups, seed=seed, stream=STREAM, num_resamples=num_resamples)
    by_cluster = resampled_counts(len(found.names), seed=seed, stream=CLUSTER_STREAM, num_resamples=num_resamples)
    rows = [np.ones((1, num_groups)), by_group, 1.0 - np.eye(num_groups), by_cluster[:, found.of_group]]
    return Design(np.concatenate(rows), num_resamples, found)


def resampled_counts(num_units: int, *, seed: int, stream: str, num_resamples: int = NUM_RESAMPLES) -> Array:
    """How often each of `num_units` groups or clusters, in a fixed order, is drawn: ``[B, units]`` of the stream.

    Raises:
        ValueError: There is no unit, or the seed does not fit.
    """
    if num_units < 1:
        raise ValueError("a bootstrap needs at least one group")
    drawn = below(words(seed, stream, num_resamples, num_units), num_units)
    line = np.arange(num_resamples)[:, None] * num_units
    counts = np.bincount((line + drawn).ravel(), minlength=num_resamples * num_units)
    return counts.reshape(num_resamples, num_units).astype(np.float64)


def ratio_of_sums(counts: Array, numerators: Array, denominators: Array) -> Array:
    """``sum_g c_g a_g / sum_g c_g b_g`` for counts ``[R, N]`` and two ``[N, K]``: ``[R, K]``."""
    above, under = np.split(sums(counts, np.concatenate([numerators, denominators], axis=1)), 2, axis=1)
    return np.asarray(np.divide(above, under, out=np.full(above.shape, np.nan), where=under > 0))


def counted_mean(counts: Array, values: Array) -> Array:
    """Mean over the groups that have a value: counts ``[R, N]``, values ``[N, K]`` with NaN for none: ``[R, K]``."""
    there = ~np.isnan(values)
    return ratio_of_sums(counts, np.where(there, values, 0.0), there.astype(np.float64))
