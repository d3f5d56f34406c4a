"""Metrics of predictions: what they are called, their values under given counts of groups, and group by group.

With the errors of `branchdrive.benchmark.metric.error`, the scales of training, and the counts ``c_g`` of groups (all 1
for the metric itself); a mean over groups runs over those that have a value::

    mae_t     = mean over g of absolute_gt          nmae_t = mae_t / iqr_t      nmae_sd_t = mae_t / sd_t
    rmse_t    = sqrt(sum_g c_g square_gt / sum_g c_g |A_gt|)
    spearman_t      = Spearman over all available (group, candidate)
    bank_spearman_t = mean over g of Spearman over A_gt, groups in which either side is constant left out
    macro_nmae, macro_nmae_sd = equal-weight mean of the six        path errors = mean over g

A macro mean of six needs all six. Group by group, for paired tests, it is the mean over the targets that the group
has; RMSE and pooled Spearman have no value of a single group.

Source: paper IV and V-C.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.metric.error import PATH_ERRORS, GroupErrors, group_errors
from branchdrive.benchmark.metric.outcome import Outcomes, Predictions
from branchdrive.benchmark.metric.scale import Scale
from branchdrive.driving.target import TARGETS
from branchdrive.statistics.bootstrap import counted_mean, ratio_of_sums
from branchdrive.statistics.spearman import bank_spearman, pooled_spearman

__all__ = ["METRICS", "PAIRED_METRICS", "Metric", "MetricValues", "metric_values"]

Array = NDArray[np.float64]


class Metric(NamedTuple):
    """One metric.

    Attributes:
        name: Kind, and after a dot the target where there is one.
        unit: ``1`` for a pure number.
        target: Name of the target; ``None`` where it concerns all of them or the path.
        lower_is_better: Whether 0 is the best value; otherwise 1 is.
    """

    name: str
    unit: str
    target: str | None
    lower_is_better: bool


def _of_targets(kind: str, *, has_unit: bool = False, lower_is_better: bool = True) -> tuple[Metric, ...]:
    return tuple(
        Metric(f"{kind}.{target.name}", target.unit if has_unit else "1", target.name, lower_is_better)
        for target in TARGETS
    )


METRICS = (
    *_of_targets("mae", has_unit=True),
    *_of_targets("nmae"),
    *_of_targets("nmae_sd"),
    *_of_targets("rmse", has_unit=True),
    *_of_targets("spearman", lower_is_better=False),
    *_of_targets("bank_spearman", lower_is_better=False),
    Metric("macro_nmae", "1", None, True),
    Metric("macro_nmae_sd", "1", None, True),
    *(Metric(name, unit, None, True) for name, unit in zip(PATH_ERRORS, ("m", "m", "deg", "m/s"), strict=True)),
)
"""All metrics, in the order of the last axis of `MetricValues`."""

PAIRED_METRICS = tuple(metric.name for metric in METRICS if not metric.name.startswith(("rmse.", "spearman.")))
"""Names of the metrics that have a value of every single group."""


class MetricValues(NamedTuple):
    """Metrics of ``P`` predictions of the same outcomes, the last axis in the order of `METRICS`.

    Attributes:
        counted: ``[P, R, M]``, a row for each row of counts; NaN where not defined.
        by_group: ``[P, N, M]``, values of single groups; NaN where a group has none.
        contributes: ``[P, N, M]``, whether a group contributes.
    """

    counted: Array
    by_group: Array
    contributes: NDArray[np.bool_]


def metric_values(
    outcomes: Outcomes, predictions: Sequence[Predictions], scale: Scale, counts: Array, *, ranks: bool = True
) -> MetricValues:
    """All metrics of `predictions` under counts of groups ``[R, N]``.

    Rank correlations take nearly all of the time; without `ranks` they are NaN.

    Raises:
        ValueError: Outcomes and predictions differ in groups or candidates.
    """
    errors = [group_errors(outcomes, predicted) for predicted in predictions]
    scalars = np.stack([predicted.scalars for predicted in predictions])
    num_predictions, num_groups, _, num_targets = scalars.shape
    banks = np.full((num_predictions, num_groups, num_targets), np.nan)
    pooled = np.full((num_predictions, len(counts), num_targets), np.nan)
    if ranks:
        banks = np.stack([bank_spearman(outcomes.scalars, values, outcomes.available) for values in scalars])
        pooled = pooled_spearman(outcomes.scalars, scalars, outcomes.available, counts)
    by_group = np.stack([_by_group(error, bank, scale) for error, bank in zip(errors, banks, strict=True)])
    contributes = ~np.isnan(by_group)
    contributes[..., [metric.name not in PAIRED_METRICS for metric in METRICS]] = np.tile(
        outcomes.available.any(axis=1), 2
    )
    parts = zip(errors, banks, pooled, strict=True)
    counted = np.stack([_counted(error, bank, rho, scale, counts) for error, bank, rho in parts])
    return MetricValues(counted, by_group, contributes)


def _counted(errors: GroupErrors, bank: Array, pooled: Array, scale: Scale, counts: Array) -> Array:
    mae = counted_mean(counts, errors.absolute)
    rmse = np.sqrt(ratio_of_sums(counts, errors.square, errors.num_available.astype(np.float64)))
    nmae, nmae_sd = mae / scale.iqr, mae / scale.sd
    macro = np.stack([nmae.mean(axis=1), nmae_sd.mean(axis=1)], axis=1)
    path = counted_mean(counts, errors.path)
    return np.concatenate([mae, nmae, nmae_sd, rmse, pooled, counted_mean(counts, bank), macro, path], axis=1)


def _by_group(errors: GroupErrors, bank: Array, scale: Scale) -> Array:
    nmae, nmae_sd = errors.absolute / scale.iqr, errors.absolute / scale.sd
    macro = np.stack([_mean_of_available(nmae), _mean_of_available(nmae_sd)], axis=1)
    none = np.full((len(bank), 2 * len(TARGETS)), np.nan)
    return np.concatenate([errors.absolute, nmae, nmae_sd, none, bank, macro, errors.path], axis=1)


def _mean_of_available(values: Array) -> Array:
    """Mean over the last axis without NaN; NaN where all of it is."""
    there = ~np.isnan(values)
    count = there.sum(axis=-1)
    total = np.where(there, values, 0.0).sum(axis=-1)
    return np.asarray(np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0))
