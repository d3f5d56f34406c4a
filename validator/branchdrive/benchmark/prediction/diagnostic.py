"""Diagnostics of predictions: how far candidates are told apart, and what shuffled inputs cost.

A shuffle looks up what a model said about another candidate or another history. That holds for models that are a
function of one history and one action, which declared models are; of others nothing is said. What a shuffle costs is
the increase of an error, and its interval is over route clusters, not over shuffles.

Spread ratio: how much of the variation between the candidates of a bank a prediction shows. For group ``g`` and target
``t`` with ``sd(y) > 1e-9``, over the available candidates::

    ratio_gt = sd(yhat) / sd(y)        reported: median over all (g, t) of ratio, and of ratio^2

A ratio below 1 compresses the differences between actions, 0 does not tell them apart. The paper says "spread" once and
"variance" once; both are reported.

Source: paper, "Action-Conditioned Outcome and Trajectory Prediction"; spec/14-benchmark.md#results.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.inputs import ResultInputs
from branchdrive.benchmark.prediction.metric.error import PATH_ERRORS, group_errors, group_mean
from branchdrive.benchmark.prediction.metric.outcome import Outcomes, Predictions
from branchdrive.benchmark.prediction.metric.shuffle import shuffles
from branchdrive.benchmark.protocol.protocol import Kind
from branchdrive.driving.target import TARGETS
from branchdrive.statistics.bca import Intervals, intervals
from branchdrive.statistics.bootstrap import Design, counted_mean
from branchdrive.statistics.rounding import number

__all__ = ["MIN_SD", "SHUFFLED_METRICS", "Spread", "diagnostic_results", "spread", "spread_ratios"]

Array = NDArray[np.float64]

SHUFFLED_METRICS = ("macro_nmae", "ade_m")
"""Metrics that are looked at after a shuffle."""

_NUM_TARGETS = len(TARGETS)
_ADE = PATH_ERRORS.index("ade_m")


def diagnostic_results(inputs: ResultInputs) -> dict[str, Any]:
    """The section ``diagnostics``."""
    protocol, part, judged = inputs.protocol, inputs.reported, inputs.judged
    declared = [model for model in judged if protocol.model(model) is not None]
    kinds = protocol.shuffles.kinds if len(part.groups) > 1 else ()
    return {
        "spread": [_spread_record(model, part.outcomes, by_seed) for model, by_seed in judged.items()],
        "shuffles": [
            record for model in declared for kind in kinds for record in _shuffle_records(inputs, model, kind)
        ],
    }


def _spread_record(model: str, outcomes: Outcomes, by_seed: Mapping[int, Predictions]) -> dict[str, Any]:
    found = [spread(outcomes, predicted) for predicted in by_seed.values()]
    return {
        "model": model,
        "sd_ratio": number(float(np.mean([each.sd_ratio for each in found]))),
        "variance_ratio": number(float(np.mean([each.variance_ratio for each in found]))),
        "num_ratios": int(min(each.num_ratios for each in found)),
    }


def _shuffle_records(inputs: ResultInputs, model: str, kind: Kind) -> list[dict[str, Any]]:
    outcomes, given = inputs.reported.outcomes, list(inputs.judged[model].values())
    size = outcomes.scalars.shape[:2]

    def values(predicted: list[Predictions]) -> tuple[Array, Array]:
        """Both metrics ``[2]`` and what they are made of ``[N, 7]``, means over seeds."""
        units = np.append(inputs.scale.iqr, 1.0)
        errors = [group_errors(outcomes, each) for each in predicted]
        by_group = np.stack([np.column_stack([each.absolute, each.path[:, _ADE]]) for each in errors])
        means = np.concatenate([counted_mean(np.ones((1, size[0])), each) for each in by_group]) / units
        metrics = np.stack([means[:, :_NUM_TARGETS].mean(axis=1), means[:, _NUM_TARGETS]], axis=1)
        return metrics.mean(axis=0), (by_group / units).mean(axis=0)

    plain, by_group = values(given)
    seeds = tuple(int(seed) for seed in inputs.protocol.shuffles.seeds)
    found = [values([s.apply(each) for each in given]) for s in shuffles(kind, *size, seeds=seeds)]
    shuffled = np.array([metrics for metrics, _ in found])
    increase, ends = _increase(np.mean([of_groups - by_group for _, of_groups in found], axis=0), inputs.resampling)
    spread_of = shuffled.std(axis=0, ddof=1) if len(shuffled) > 1 else np.full(len(SHUFFLED_METRICS), np.nan)
    return [
        {
            "model": model,
            "kind": kind,
            "metric": metric,
            "value": number(plain[i]),
            "shuffled": number(float(shuffled[:, i].mean())),
            "shuffle_sd": number(float(spread_of[i])),
            "increase": number(increase[i]),
            "cluster_low": number(ends.cluster_low[i]),
            "cluster_high": number(ends.cluster_high[i]),
            "num_shuffles": len(shuffled),
        }
        for i, metric in enumerate(SHUFFLED_METRICS)
    ]


def _increase(by_group: Array, resampling: Design) -> tuple[Array, Intervals]:
    """Increase of both metrics ``[2]`` and its intervals, of the increases that they are made of ``[N, 7]``."""
    counted = counted_mean(resampling, by_group)
    parts = resampling.split(np.stack([counted[:, :_NUM_TARGETS].mean(axis=1), counted[:, -1]], axis=1))
    there = ~np.isnan(by_group)
    there = np.stack([there[:, :_NUM_TARGETS].any(axis=1), there[:, -1]], axis=1)
    return parts[0], intervals(*parts, there.sum(axis=0), resampling.clusters.num_there(there))


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
