"""Metrics of predictions: what they are called, their values under given counts of groups, and group by group.

A metric is an entry of `metrics.json` and a formula of `branchdrive.benchmark.prediction.metric.formula`; schemas,
tables and figures follow from the entry.

Source: spec/14-benchmark.md#metrics.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.metric.error import group_errors
from branchdrive.benchmark.prediction.metric.formula import FORMULAS, Judged
from branchdrive.benchmark.prediction.metric.outcome import Outcomes, Predictions
from branchdrive.benchmark.prediction.metric.scale import Scale
from branchdrive.contract.metric import DECLARED_METRICS, DeclaredMetric
from branchdrive.driving.target import TARGETS
from branchdrive.statistics.bootstrap import Design
from branchdrive.statistics.spearman import bank_spearman, pooled_spearman

__all__ = ["HEADLINES", "METRICS", "METRICS_OF_TARGETS", "PAIRED_METRICS", "Metric", "MetricValues", "metric_values"]

Array = NDArray[np.float64]
_TARGETS = tuple(target.name for target in TARGETS)


class Metric(NamedTuple):
    """One metric.

    Attributes:
        name: As declared, and after a dot the target where there is one.
        title: For people.
        unit: ``1`` for a pure number.
        best: Value of a perfect prediction: 0 where lower is better, else 1.
    """

    name: str
    title: str
    unit: str
    best: int

    @property
    def heading(self) -> str:
        """Title and unit."""
        return self.title if self.unit == "1" else f"{self.title}, {self.unit}"


def _members(declared: DeclaredMetric) -> tuple[Metric, ...]:
    units = [target.unit for target in TARGETS] if declared.unit == "target" else [declared.unit] * len(TARGETS)
    return tuple(
        Metric(name, declared.title, unit, declared.best)
        for name, unit in zip(declared.names(_TARGETS), units, strict=False)
    )


METRICS = tuple(metric for declared in DECLARED_METRICS for metric in _members(declared))
"""All metrics, in the order of the last axis of `MetricValues`."""

HEADLINES = tuple(metric for declared in DECLARED_METRICS if not declared.per_target for metric in _members(declared))
"""Metrics of all targets together, or of the path."""

METRICS_OF_TARGETS = tuple(
    sorted(
        (declared for declared in DECLARED_METRICS if declared.per_target),
        key=lambda declared: (declared.best, declared.unit == "target"),
    )
)
"""As declared: errors that are pure numbers, errors in units, correlations."""

PAIRED_METRICS = tuple(name for declared in DECLARED_METRICS if declared.paired for name in declared.names(_TARGETS))
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
    outcomes: Outcomes, predictions: Sequence[Predictions], scale: Scale, counts: Array | Design
) -> MetricValues:
    """All metrics of `predictions` under counts of groups ``[R, N]``.

    Raises:
        ValueError: Outcomes and predictions differ in groups or candidates.
    """
    errors = [group_errors(outcomes, predicted) for predicted in predictions]
    scalars = np.stack([predicted.scalars for predicted in predictions])
    banks = [bank_spearman(outcomes.scalars, values, outcomes.available) for values in scalars]
    pooled = pooled_spearman(outcomes.scalars, scalars, outcomes.available, counts)
    parts = zip(predictions, errors, banks, pooled, strict=True)
    found = [
        _values(Judged(outcomes, predicted, error, scale, counts, bank, rho)) for predicted, error, bank, rho in parts
    ]
    return MetricValues(*(np.stack(field) for field in zip(*found, strict=True)))


def _values(judged: Judged) -> MetricValues:
    """All metrics of one prediction, without the axis of predictions."""
    has_outcome = np.asarray(judged.outcomes.available.any(axis=1))
    counted, by_group, contributes = [], [], []
    for declared in DECLARED_METRICS:
        formula = FORMULAS[declared.name]
        counted.append(formula.counted(judged))
        if formula.by_group is None:
            by_group.append(np.full(has_outcome.shape, np.nan))
            contributes.append(has_outcome)
        else:
            by_group.append(formula.by_group(judged))
            contributes.append(~np.isnan(by_group[-1]))
    return MetricValues(*(np.concatenate(field, axis=1) for field in (counted, by_group, contributes)))
