"""Bootstrap intervals of 95 %: percentile and bias-corrected accelerated (BCa) by groups, percentile by route clusters.

With the estimate ``e``, its resamples ``e*``, the jackknife ``e_(g)`` with mean ``e_(.)``, and the normal
distribution ``Phi``::

    percentile  quantiles of e* at 0.025 and 0.975, linear
    z0 = Phi^-1((#{e* below e} + #{e* that tie with e} / 2) / B)
    a  = sum_g (e_(.) - e_(g))^3 / (6 (sum_g (e_(.) - e_(g))^2)^(3/2))      0 where all e_(g) tie with e_(.)
    BCa         quantiles of e* at Phi(z0 + (z0 + z) / (1 - a (z0 + z))) for z = Phi^-1(0.025), Phi^-1(0.975)

Numbers tie as in `branchdrive.statistics.rounding`, of the magnitude of the largest ``|e|`` or ``|e*|``. Resamples
in which the metric is not defined are left out and counted. An interval needs two groups, or two clusters, that
contribute. BCa is NaN where the estimate lies outside all resamples or a jackknife value is not defined.

Source: Efron 1987; Efron and Tibshirani 1993.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.statistics.bootstrap import Design, ratio_of_sums
from branchdrive.statistics.rounding import slack

__all__ = ["LEAST_UNITS", "LEVELS", "Intervals", "intervals", "ratio_intervals"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEVELS = (0.025, 0.975)

LEAST_UNITS = 1 + math.ceil(math.log2(1 / (2 * LEVELS[0])))
"""Fewest groups, or clusters, of which an interval can have its level.

Values of ``n`` units all lie on one side of their median by chance ``2^(1 - n)``: so often does an interval within
their range miss it, and no sign flip of the units has a smaller p-value.
"""

_NORMAL = NormalDist()

_CELLS_AT_ONCE = 1 << 21
"""Resampled values that are held at once: 16 MiB for each intermediate array."""


class Intervals(NamedTuple):
    """Intervals of ``K`` metrics, every field ``[K]``; ends are NaN where there is none.

    Attributes:
        low: Lower percentile end.
        high: Upper percentile end.
        bca_low: Lower BCa end.
        bca_high: Upper BCa end.
        num_undefined: Resamples without the metric.
        cluster_low: Lower percentile end over resamples of clusters.
        cluster_high: Upper percentile end over resamples of clusters.
        cluster_num_undefined: Resamples of clusters without the metric.
    """

    low: Array
    high: Array
    bca_low: Array
    bca_high: Array
    num_undefined: NDArray[np.int64]
    cluster_low: Array
    cluster_high: Array
    cluster_num_undefined: NDArray[np.int64]


def intervals(
    estimate: Array,
    resamples: Array,
    jackknife: Array,
    by_cluster: Array,
    num_groups: NDArray[np.int64],
    num_clusters: NDArray[np.int64],
) -> Intervals:
    """Intervals of metrics.

    Args:
        estimate: ``[K]``.
        resamples: ``[B, K]``.
        jackknife: ``[N, K]``.
        by_cluster: ``[B, K]``, resamples of clusters.
        num_groups: ``[K]``, groups that contribute.
        num_clusters: ``[K]``, clusters that contribute.
    """
    ordered, num_defined, undefined = _ordered(estimate, resamples, num_groups)
    low, high = _percentiles(ordered, num_defined)
    levels = _bca_levels(estimate, resamples, jackknife, num_defined)
    bca_low, bca_high = (_quantile(ordered, num_defined, level) for level in levels)
    ordered, num_defined, cluster_undefined = _ordered(estimate, by_cluster, num_clusters)
    cluster_low, cluster_high = _percentiles(ordered, num_defined)
    return Intervals(low, high, bca_low, bca_high, undefined, cluster_low, cluster_high, cluster_undefined)


def ratio_intervals(resampling: Design, numerators: Array, denominators: Array, there: Mask) -> tuple[Array, Intervals]:
    """Ratios of sums over groups ``[K]``, and their intervals.

    Args:
        resampling: Of the groups.
        numerators: ``[N, K]``.
        denominators: ``[N, K]``.
        there: Which groups contribute ``[N, K]``.
    """
    at_once = max(1, _CELLS_AT_ONCE // len(resampling))
    parts = [slice(start, start + at_once) for start in range(0, numerators.shape[1], at_once)]
    estimates, ends = [], []
    for part in parts:
        of_part = resampling.split(ratio_of_sums(resampling, numerators[:, part], denominators[:, part]))
        is_there = there[:, part]
        estimates.append(of_part[0])
        ends.append(intervals(*of_part, is_there.sum(axis=0), resampling.clusters.num_there(is_there)))
    return np.concatenate(estimates), Intervals(*(np.concatenate(field) for field in zip(*ends, strict=True)))


def _ordered(
    estimate: Array, resamples: Array, num_units: NDArray[np.int64]
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Ascending resamples, how many of them make an interval, and how many are not defined."""
    undefined = np.isnan(resamples).sum(axis=0)
    num_defined = np.where(np.isnan(estimate) | (num_units < 2), 0, len(resamples) - undefined)
    return np.sort(resamples, axis=0), num_defined, undefined  # NaN last


def _percentiles(ordered: Array, num_defined: NDArray[np.int64]) -> tuple[Array, Array]:
    low, high = (_quantile(ordered, num_defined, np.full(len(num_defined), level)) for level in LEVELS)
    return low, high


def _quantile(ordered: Array, num_defined: NDArray[np.int64], level: Array) -> Array:
    """Linear quantiles of the first `num_defined` of each column; NaN where there is none, or no level."""
    there = (num_defined > 0) & ~np.isnan(level)
    place = np.where(there, level, 0.0) * np.maximum(num_defined - 1, 0)
    lower_place = np.floor(place).astype(np.int64)
    column = np.arange(len(level))
    lower = ordered[lower_place, column]
    upper = ordered[np.minimum(lower_place + 1, np.maximum(num_defined - 1, 0)), column]
    return np.where(there, lower + (upper - lower) * (place - lower_place), np.nan)


def _bca_levels(
    estimate: Array, resamples: Array, jackknife: Array, num_defined: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Levels of the two BCa ends, NaN where they are not defined."""
    tie = slack(np.fmax(np.abs(estimate), np.fmax.reduce(np.abs(resamples), axis=0)))
    smaller = (resamples < estimate - tie).sum(axis=0) + (resamples <= estimate + tie).sum(axis=0)
    influence = jackknife.mean(axis=0) - jackknife
    influence = np.where(np.abs(influence).max(axis=0) <= tie, 0.0, influence)
    spread = (influence**2).sum(axis=0) ** 1.5
    levels = np.full((2, len(estimate)), np.nan)
    for k in np.flatnonzero((num_defined > 0) & (smaller > 0) & (smaller < 2 * num_defined) & ~np.isnan(spread)):
        z0 = _NORMAL.inv_cdf(float(smaller[k] / (2 * num_defined[k])))
        acceleration = float((influence[:, k] ** 3).sum() / (6 * spread[k])) if spread[k] > 0 else 0.0
        for end, level in enumerate(LEVELS):
            shifted = z0 + _NORMAL.inv_cdf(level)
            if acceleration * shifted < 1:
                levels[end, k] = _NORMAL.cdf(z0 + shifted / (1 - acceleration * shifted))
    return levels[0], levels[1]
