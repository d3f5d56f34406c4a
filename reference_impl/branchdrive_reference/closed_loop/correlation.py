"""Whether an offline figure orders selectors as driving does: correlations over selectors, by scipy.

A point is a selector, with the mean of an offline figure and its mean driving score over the same groups. Intervals of
95 % are percentiles over resamples of route clusters, shared by both; they tell what other groups would have given, not
what other selectors would. R2 is that of a line. A resample in which a figure is the same for all selectors has no
correlation and is left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.runtime.environment import extra
from branchdrive.statistics.bootstrap import resampled_counts
from branchdrive.statistics.cluster import Clusters
from branchdrive.statistics.rounding import number, slack, sums

__all__ = ["COEFFICIENTS", "LEAST_SELECTORS", "correlations"]

Array = NDArray[np.float64]

COEFFICIENTS = ("spearman", "kendall", "r2")

LEAST_SELECTORS = 3
"""Two selectors have one order or the other."""

MOST_RESAMPLES = 500
"""Resamples that scipy is asked about one by one."""

_STREAM = "closed-loop/correlation"


def correlations(
    offline: Array, driven: Array, clusters: Clusters, *, seed: int, num_resamples: int
) -> dict[str, dict[str, float | None]] | None:
    """Each of `COEFFICIENTS` with its interval; ``None`` for too few selectors or where a figure is equal for all.

    Args:
        offline: A figure by group and selector ``[N, S]``, higher the better.
        driven: Driving scores ``[N, S]``.
        clusters: Route clusters of the groups.
        seed: Of the resamples.
        num_resamples: How many; at most `MOST_RESAMPLES` are drawn.

    Raises:
        PlatformError: The extra is not installed.
    """
    if offline.shape[1] < LEAST_SELECTORS or not len(offline):
        return None
    estimates = _coefficients(offline.mean(axis=0)[None], driven.mean(axis=0)[None])
    if not len(estimates):
        return None
    counts = resampled_counts(
        len(clusters.names), seed=seed, stream=_STREAM, num_resamples=min(num_resamples, MOST_RESAMPLES)
    )
    sizes = sums(counts, clusters.sums(np.ones((len(offline), 1))))
    means = [sums(counts, clusters.sums(values)) / sizes for values in (offline, driven)]
    drawn = _coefficients(*means)
    ends = np.quantile(drawn, [0.025, 0.975], axis=0).T if len(drawn) else np.full((len(COEFFICIENTS), 2), np.nan)
    return {
        name: {"value": value, "low": number(low), "high": number(high)}
        for name, value, (low, high) in zip(COEFFICIENTS, estimates[0].tolist(), ends.tolist(), strict=True)
    }


def _coefficients(x: Array, y: Array) -> Array:
    """Coefficients ``[R, 3]`` over selectors ``[R, S]``, without the rows in which either is the same for all."""
    with extra("drive", of="`drive`"):
        from scipy import stats
    varies = [np.ptp(values, axis=1) > slack(np.abs(values).max(axis=1)) for values in (x, y)]
    x, y = (values[varies[0] & varies[1]] for values in (x, y))
    if not len(x):
        return np.zeros((0, len(COEFFICIENTS)))
    levels = [_levels(values) for values in (x, y)]
    ranks = [stats.rankdata(values, axis=1) for values in levels]
    return np.stack(
        [
            stats.pearsonr(*ranks, axis=1).statistic,
            [stats.kendalltau(*row).statistic for row in zip(*levels, strict=True)],
            stats.pearsonr(x, y, axis=1).statistic ** 2,
        ],
        axis=1,
    )


def _levels(values: Array) -> NDArray[np.int64]:
    """Levels of values ``[R, S]`` in ascending order, those that tie on one: last bits order no selectors."""
    order = np.argsort(values, axis=1)
    rises = np.diff(np.take_along_axis(values, order, axis=1), axis=1)
    parted = rises > slack(np.abs(values).max(axis=1, keepdims=True))
    levels = np.zeros(values.shape, np.int64)
    np.put_along_axis(levels, order[:, 1:], np.cumsum(parted, axis=1), axis=1)
    return levels
