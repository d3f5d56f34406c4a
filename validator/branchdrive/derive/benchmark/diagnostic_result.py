"""Diagnostics of predictions: how far candidates are told apart, and what shuffled inputs cost.

A shuffle looks up what a model said about another candidate or another history. That holds for models that are a
function of one history and one action, which declared models are; of others nothing is said.

Source: paper V-D; spec/14-benchmark.md#results.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from branchdrive.derive.benchmark.data import BenchmarkData
from branchdrive.derive.benchmark.number import number
from branchdrive.derive.benchmark.prediction_set import PredictionSet
from branchdrive.derive.benchmark.protocol import BenchmarkProtocol
from branchdrive.derive.metric.metric import METRICS, metric_values
from branchdrive.derive.metric.outcome import Outcomes, Predictions
from branchdrive.derive.metric.scale import Scale
from branchdrive.derive.metric.shuffle import Kind, shuffles
from branchdrive.derive.metric.spread import spread

__all__ = ["SHUFFLED_METRICS", "diagnostic_results"]

SHUFFLED_METRICS = ("macro_nmae", "ade_m")
"""Metrics that are looked at after a shuffle."""

_PLACES = [[metric.name for metric in METRICS].index(name) for name in SHUFFLED_METRICS]


def diagnostic_results(
    protocol: BenchmarkProtocol, data: BenchmarkData, predictions: PredictionSet, scale: Scale
) -> dict[str, Any]:
    """The section ``diagnostics``."""
    part = data.part(protocol.partitions.report)
    judged = predictions.of(protocol.partitions.report)
    declared = [model for model in judged if protocol.model(model) is not None]
    kinds = protocol.shuffles.kinds if len(part.groups) > 1 else ()
    return {
        "spread": [_spread_record(model, part.outcomes, by_seed) for model, by_seed in judged.items()],
        "shuffles": [
            record
            for model in declared
            for kind in kinds
            for record in _shuffle_records(protocol, model, kind, part.outcomes, judged[model], scale)
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
) -> list[dict[str, Any]]:
    given = list(by_seed.values())
    size = outcomes.scalars.shape[:2]
    counts = np.ones((1, size[0]))

    def values(predicted: list[Predictions]) -> list[float]:
        found = metric_values(outcomes, predicted, scale, counts, ranks=False).counted[:, 0, _PLACES]
        means: list[float] = found.mean(axis=0).tolist()
        return means

    plain = values(given)
    seeds = tuple(int(seed) for seed in protocol.shuffles.seeds)
    shuffled = np.array([values([s.apply(each) for each in given]) for s in shuffles(kind, *size, seeds=seeds)])
    spread_of = shuffled.std(axis=0, ddof=1) if len(shuffled) > 1 else np.full(len(_PLACES), np.nan)
    return [
        {
            "model": model,
            "kind": kind,
            "metric": metric,
            "value": number(plain[i]),
            "shuffled": number(float(shuffled[:, i].mean())),
            "shuffle_sd": number(float(spread_of[i])),
            "num_shuffles": len(shuffled),
        }
        for i, metric in enumerate(SHUFFLED_METRICS)
    ]
