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
from branchdrive.statistics.rounding import slack, sums

__all__ = ["COEFFICIENTS", "LEAST_SELECTORS", "correlations"]

Array = NDArray[np.float64]

COEFFICIENTS = ("spearman", "kendall", "r2")

LEAST_SELECTORS = 3
"""Two selectors have one order or the other."""

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
        num_resamples: How many.

    Raises:
        PlatformError: The extra is not installed.
    """
    if offline.shape[1] < LEAST_SELECTORS or not len(offline):
        return None
    estimate = _coefficients(offline.mean(axis=0), driven.mean(axis=0))
    if estimate is None:
        return None
    counts = resampled_counts(len(clusters.names), seed=seed, stream=_STREAM, num_resamples=num_resamples)
    sizes = sums(counts, clusters.sums(np.ones((len(offline), 1))))
    means = [sums(counts, clusters.sums(values)) / sizes for values in (offline, driven)]
    drawn = [found for pair in zip(*means, strict=True) if (found := _coefficients(*pair)) is not None]
    ends = np.quantile(np.array(drawn), [0.025, 0.975], axis=0).T if drawn else np.full((len(COEFFICIENTS), 2), np.nan)
    return {
        name: {"value": value, "low": _known(low), "high": _known(high)}
        for name, value, (low, high) in zip(COEFFICIENTS, estimate, ends.tolist(), strict=True)
    }


def _coefficients(x: Array, y: Array) -> tuple[float, float, float] | None:
    with extra("drive", of="`drive`"):
        from scipy import stats
    if any(np.ptp(values) <= slack(np.abs(values).max()) for values in (x, y)):
        return None
    return (
        float(stats.spearmanr(x, y).statistic),
        float(stats.kendalltau(x, y).statistic),
        float(stats.pearsonr(x, y).statistic ** 2),
    )


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None
