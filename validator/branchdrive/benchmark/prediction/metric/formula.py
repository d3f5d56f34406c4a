"""Formulas of the metrics that `metrics.json` declares.

With the errors of `branchdrive.benchmark.prediction.metric.error`, the scales of training, and the counts ``c_g`` of
groups (all 1 for the metric itself); a mean over groups runs over those that have a value::

    mae_t     = mean over g of absolute_gt          nmae_t = mae_t / iqr_t      nmae_sd_t = mae_t / sd_t
    rmse_t    = sqrt(sum_g c_g square_gt / sum_g c_g |A_gt|)
    spearman_t      = Spearman over all available (group, candidate)
    bank_spearman_t = mean over g of Spearman over A_gt, groups in which either side is constant left out
    macro_nmae, macro_nmae_sd = equal-weight mean of the six        path errors = mean over g

A macro mean of six needs all six. Group by group, for paired tests, it is the mean over the targets that the group
has; RMSE and pooled Spearman have no value of a single group.

Source: paper, "Benchmark Protocol" and "Metrics and Statistics".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.metric.error import PATH_ERRORS, GroupErrors
from branchdrive.benchmark.prediction.metric.outcome import Outcomes, Predictions
from branchdrive.benchmark.prediction.metric.scale import Scale
from branchdrive.statistics.bootstrap import Design, counted_mean, ratio_of_sums

__all__ = ["FORMULAS", "Formula", "Judged", "mean_over_groups"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Judged:
    """One prediction of outcomes, with what formulas share.

    Attributes:
        outcomes: What was recorded.
        predictions: What was predicted.
        errors: Of the predictions, group by group.
        scale: Of the targets.
        counts: ``[R, N]``, counts of groups.
        bank_spearman: ``[N, 6]``; NaN where a side is constant.
        pooled_spearman: ``[R, 6]``, in the same way.
    """

    outcomes: Outcomes
    predictions: Predictions
    errors: GroupErrors
    scale: Scale
    counts: Array | Design
    bank_spearman: Array
    pooled_spearman: Array

    @cached_property
    def mae(self) -> Array:
        """Mean absolute errors ``[R, 6]``."""
        return counted_mean(self.counts, self.errors.absolute)

    @cached_property
    def path(self) -> Array:
        """Errors of paths ``[R, 4]``, in the order of `PATH_ERRORS`."""
        return counted_mean(self.counts, self.errors.path)


Values = Callable[[Judged], Array]


class Formula(NamedTuple):
    """How a metric is computed, of all targets at once where it is one of targets; else ``K`` is 1.

    Attributes:
        counted: ``[R, K]``, a row for each row of counts; NaN where not defined.
        by_group: ``[N, K]``, values of single groups, NaN where a group has none; ``None`` where the metric has no
            value of a single group.
    """

    counted: Values
    by_group: Values | None = None


def mean_over_groups(by_group: Values) -> Formula:
    """The metric whose value is the mean of its values of single groups."""
    return Formula(lambda judged: counted_mean(judged.counts, by_group(judged)), by_group)


def _scaled(scale_of: Callable[[Scale], Array]) -> Formula:
    return Formula(lambda j: j.mae / scale_of(j.scale), lambda j: j.errors.absolute / scale_of(j.scale))


def _macro(scale_of: Callable[[Scale], Array]) -> Formula:
    """Equal-weight mean over targets: of all six, and group by group of those that the group has."""
    return Formula(
        lambda j: (j.mae / scale_of(j.scale)).mean(axis=1, keepdims=True),
        lambda j: _mean_of_available(j.errors.absolute / scale_of(j.scale))[:, None],
    )


def _path(name: str) -> Formula:
    place = PATH_ERRORS.index(name)
    return Formula(lambda j: j.path[:, place, None], lambda j: j.errors.path[:, place, None])


def _rmse(judged: Judged) -> Array:
    errors = judged.errors
    return np.sqrt(ratio_of_sums(judged.counts, errors.square, errors.num_available.astype(np.float64)))


def _mean_of_available(values: Array) -> Array:
    """Mean over the last axis without NaN; NaN where all of it is."""
    there = ~np.isnan(values)
    count = there.sum(axis=-1)
    total = np.where(there, values, 0.0).sum(axis=-1)
    return np.asarray(np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0))


FORMULAS: Mapping[str, Formula] = MappingProxyType(
    {
        "mae": Formula(lambda j: j.mae, lambda j: j.errors.absolute),
        "nmae": _scaled(attrgetter("iqr")),
        "nmae_sd": _scaled(attrgetter("sd")),
        "rmse": Formula(_rmse),
        "spearman": Formula(lambda j: j.pooled_spearman),
        "bank_spearman": mean_over_groups(lambda j: j.bank_spearman),
        "macro_nmae": _macro(attrgetter("iqr")),
        "macro_nmae_sd": _macro(attrgetter("sd")),
        **{name: _path(name) for name in PATH_ERRORS},
    }
)
"""By the declared name."""
