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

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.inputs import ResultInputs
from branchdrive.benchmark.prediction.metric.error import absolute_errors, group_mean
from branchdrive.benchmark.prediction.metric.outcome import Outcomes, Predictions
from branchdrive.benchmark.prediction.metric.shuffle import Shuffle, shuffles
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
_CELLS_AT_ONCE = 1 << 20
"""Coordinates of shuffled paths that are looked at together: 8 MiB."""


def diagnostic_results(inputs: ResultInputs) -> dict[str, Any]:
    """The section ``diagnostics``."""
    protocol, part, judged = inputs.protocol, inputs.reported, inputs.judged
    declared = [model for model in judged if protocol.model(model) is not None]
    kinds = protocol.shuffles.kinds if len(part.groups) > 1 else ()
    seeds = tuple(int(seed) for seed in protocol.shuffles.seeds)
    drawn = {kind: tuple(shuffles(kind, *part.outcomes.complete.shape, seeds=seeds)) for kind in kinds}
    return {
        "spread": [_spread_record(model, part.outcomes, by_seed) for model, by_seed in judged.items()],
        "shuffles": [
            record
            for model in declared
            for kind, of_kind in drawn.items()
            for record in _shuffle_records(inputs, model, kind, of_kind)
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


def _shuffle_records(inputs: ResultInputs, model: str, kind: Kind, drawn: Sequence[Shuffle]) -> list[dict[str, Any]]:
    outcomes, given = inputs.reported.outcomes, inputs.judged[model].values()
    units = np.append(inputs.scale.iqr, 1.0)
    scalars, places = np.stack([each.scalars for each in given]), np.stack([each.paths[..., :2] for each in given])

    def values(of_seeds: Array) -> tuple[Array, Array]:
        """Both metrics ``[Q, 2]`` and what they are made of ``[Q, N, 7]``, means over seeds ``[seeds, Q, N, 7]``."""
        by_column = np.moveaxis(of_seeds, 2, 0).reshape(of_seeds.shape[2], -1)
        means = counted_mean(np.ones((1, len(by_column))), by_column).reshape(*of_seeds.shape[:2], -1) / units
        metrics = np.stack([means[..., :_NUM_TARGETS].mean(axis=-1), means[..., _NUM_TARGETS]], axis=-1)
        return metrics.mean(axis=0), (of_seeds / units).mean(axis=0)

    (plain,), (by_group,) = values(absolute_errors(outcomes, scalars, places)[:, None])
    at_once = max(1, _CELLS_AT_ONCE // places.size)
    errors = []
    for start in range(0, len(drawn), at_once):
        part = drawn[start : start + at_once]
        said = (np.stack([shuffle.apply(each) for shuffle in part], axis=1) for each in (scalars, places))
        errors.append(absolute_errors(outcomes, *said))
    shuffled, of_groups = values(np.concatenate(errors, axis=1))
    increase, ends = _increase((of_groups - by_group).mean(axis=0), inputs.resampling)
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
