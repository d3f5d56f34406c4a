"""Spread ratio: how much of the variation between the candidates of a bank a prediction shows.

For group ``g`` and target ``t`` with ``sd(y) > 1e-9``, over the available candidates::

    ratio_gt = sd(yhat) / sd(y)        reported: median over all (g, t) of ratio, and of ratio^2

A ratio below 1 compresses the differences between actions, 0 does not tell them apart.

Source: paper, "Action-Conditioned Outcome and Trajectory Prediction", which says "spread" once and "variance" once;
both are reported.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.metric.error import group_mean
from branchdrive.benchmark.metric.outcome import Outcomes, Predictions

__all__ = ["MIN_SD", "Spread", "spread", "spread_ratios"]

Array = NDArray[np.float64]

MIN_SD = 1e-9
"""Candidates whose outcome varies less do not differ."""


class Spread(NamedTuple):
    """Medians over groups and targets; NaN where `num_ratios` is 0."""

    sd_ratio: float
    variance_ratio: float
    num_ratios: int


def spread_ratios(outcomes: Outcomes, predictions: Predictions) -> Array:
    """``sd(yhat) / sd(y)`` as ``[N, 6]``; NaN where the outcome does not vary."""
    true, predicted = (_sd(values, outcomes) for values in (outcomes.scalars, predictions.scalars))
    return np.asarray(np.divide(predicted, true, out=np.full(true.shape, np.nan), where=true > MIN_SD))


def spread(outcomes: Outcomes, predictions: Predictions) -> Spread:
    """Medians of the ratios of standard deviations and of variances."""
    ratios = spread_ratios(outcomes, predictions)
    found = ratios[~np.isnan(ratios)]
    if not found.size:
        return Spread(np.nan, np.nan, 0)
    return Spread(float(np.median(found)), float(np.median(found**2)), found.size)


def _sd(values: Array, outcomes: Outcomes) -> Array:
    """Population standard deviation over the available candidates, ``[N, 6]``."""
    shifted = values - values[:, :1]  # equal values have a deviation of exactly 0
    mean = group_mean(shifted, outcomes.available)
    return np.sqrt(group_mean(np.square(shifted - mean[:, None]), outcomes.available))
