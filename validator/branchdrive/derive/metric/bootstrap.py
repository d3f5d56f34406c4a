"""Group bootstrap: how often each group counts in each resample, the same for all models and metrics.

A resample draws ``N`` groups with replacement, so its counts are multinomial. A metric is a function of counts::

    estimate   all counts 1
    resamples  counts c_1 .. c_B
    jackknife  all counts 1 but that of one group, which is 0

and a mean over groups is the ratio of sums ``sum_g c_g a_g / sum_g c_g b_g``, NaN where the lower one is 0.

Source: Efron and Tibshirani 1993; the group is the unit, paper V-C.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.derive.metric.stream import below, words

__all__ = ["NUM_RESAMPLES", "Design", "counted_mean", "design", "ratio_of_sums", "resampled_counts"]

Array = NDArray[np.float64]

NUM_RESAMPLES = 2000
STREAM = "metric/bootstrap"


class Design(NamedTuple):
    """Counts ``[1 + B + N, N]``: the estimate, `num_resamples` resamples, the jackknife."""

    counts: Array
    num_resamples: int

    def split(self, values: Array) -> tuple[Array, Array, Array]:
        """Values ``[1 + B + N, ..]`` of a metric as estimate ``[..]``, resamples ``[B, ..]``, jackknife ``[N, ..]``."""
        return values[0], values[1 : 1 + self.num_resamples], values[1 + self.num_resamples :]


def design(num_groups: int, *, seed: int, num_resamples: int = NUM_RESAMPLES) -> Design:
    """Counts for groups in a fixed order, that of their ids.

    Raises:
        ValueError: There is no group, or the seed does not fit.
    """
    counts = resampled_counts(num_groups, seed=seed, stream=STREAM, num_resamples=num_resamples)
    return Design(np.concatenate([np.ones((1, num_groups)), counts, 1.0 - np.eye(num_groups)]), num_resamples)


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
    above, under = counts @ numerators, counts @ denominators
    return np.asarray(np.divide(above, under, out=np.full(above.shape, np.nan), where=under > 0))


def counted_mean(counts: Array, values: Array) -> Array:
    """Mean over the groups that have a value: counts ``[R, N]``, values ``[N, K]`` with NaN for none: ``[R, K]``."""
    there = ~np.isnan(values)
    return ratio_of_sums(counts, np.where(there, values, 0.0), there.astype(np.float64))
