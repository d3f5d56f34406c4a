"""Diagnostics of predictions: how far candidates are told apart, and what shuffled inputs cost.

A shuffle looks up what a model said about another candidate or another history. That holds for models that are a
function of one history and one action, which declared models are; of others nothing is said. What a shuffle costs is
the increase of an error, and its interval is over route clusters, not over shuffles.

Source: paper, "Action-Conditioned Outcome and Trajectory Prediction"; spec/14-benchmark.md#results.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.data import BenchmarkData
from branchdrive.benchmark.metric.error import PATH_ERRORS, group_errors
from branchdrive.benchmark.metric.outcome import Outcomes, Predictions
from branchdrive.benchmark.metric.scale import Scale
from branchdrive.benchmark.metric.shuffle import Kind, shuffles
from branchdrive.benchmark.metric.spread import spread
from branchdrive.benchmark.prediction_set import PredictionSet
from branchdrive.benchmark.protocol import BenchmarkProtocol
from branchdrive.driving.target import TARGETS
from branchdrive.statistics.bca import Intervals, intervals
from branchdrive.statistics.bootstrap import Design, counted_mean, design
from branchdrive.statistics.rounding import number

__all__ = ["SHUFFLED_METRICS", "diagnostic_results"]

Array = NDArray[np.float64]

SHUFFLED_METRICS = ("macro_nmae", "ade_m")
"""Metrics that are looked at after a shuffle."""

_NUM_TARGETS = len(TARGETS)
_ADE = PATH_ERRORS.index("ade_m")


def diagnostic_results(
    protocol: BenchmarkProtocol, data: BenchmarkData, predictions: PredictionSet, scale: Scale
) -> dict[str, Any]:
    """The section ``diagnostics``."""
    part = data.part(protocol.partitions.report)
    judged = predictions.of(protocol.partitions.report)
    declared = [model for model in judged if protocol.model(model) is not None]
    kinds = protocol.shuffles.kinds if len(part.groups) > 1 else ()
    about = protocol.statistics
    resampling = design(part.clusters, seed=int(about.seed), num_resamples=int(about.resamples))
    return {
        "spread": [_spread_record(model, part.outcomes, by_seed) for model, by_seed in judged.items()],
        "shuffles": [
            record
            for model in declared
            for kind in kinds
            for record in _shuffle_records(protocol, model, kind, part.outcomes, judged[model], scale, resampling)
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


def _shuffle_records(
    protocol: BenchmarkProtocol,
    model: str,
    kind: Kind,
    outcomes: Outcomes,
    by_seed: Mapping[int, Predictions],
    scale: Scale,
    resampling: Design,
) -> list[dict[str, Any]]:
    given = list(by_seed.values())
    size = outcomes.scalars.shape[:2]

    def values(predicted: list[Predictions]) -> tuple[Array, Array]:
        """Both metrics ``[2]`` and what they are made of ``[N, 7]``, means over seeds."""
        units = np.append(scale.iqr, 1.0)
        errors = [group_errors(outcomes, each) for each in predicted]
        by_group = np.stack([np.column_stack([each.absolute, each.path[:, _ADE]]) for each in errors])
        means = np.concatenate([counted_mean(np.ones((1, size[0])), each) for each in by_group]) / units
        metrics = np.stack([means[:, :_NUM_TARGETS].mean(axis=1), means[:, _NUM_TARGETS]], axis=1)
        return metrics.mean(axis=0), (by_group / units).mean(axis=0)

    plain, by_group = values(given)
    seeds = tuple(int(seed) for seed in protocol.shuffles.seeds)
    found = [values([s.apply(each) for each in given]) for s in shuffles(kind, *size, seeds=seeds)]
    shuffled = np.array([metrics for metrics, _ in found])
    increase, ends = _increase(np.mean([of_groups - by_group for _, of_groups in found], axis=0), resampling)
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
    counted = counted_mean(resampling.counts, by_group)
    parts = resampling.split(np.stack([counted[:, :_NUM_TARGETS].mean(axis=1), counted[:, -1]], axis=1))
    there = ~np.isnan(by_group)
    there = np.stack([there[:, :_NUM_TARGETS].any(axis=1), there[:, -1]], axis=1)
    return parts[0], intervals(*parts, there.sum(axis=0), resampling.clusters.num_there(there))
