"""The document `results.json`: everything that follows from predictions, outcomes and what was locked.

The same inputs give the same document, whatever the order of rows: nothing is drawn but from named streams of the
protocol's seed. What is unknown or not defined is null.

Source: spec/14-benchmark.md#results.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from branchdrive.benchmark.guard.record import further_guard_results, guard_results
from branchdrive.benchmark.guard.risk import RiskFit, Risks
from branchdrive.benchmark.prediction.data import BenchmarkData
from branchdrive.benchmark.prediction.diagnostic import diagnostic_results
from branchdrive.benchmark.prediction.inputs import ResultInputs
from branchdrive.benchmark.prediction.prediction_set import PredictionSet
from branchdrive.benchmark.prediction.record import prediction_results
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
from branchdrive.benchmark.ranking.context import Contexts
from branchdrive.benchmark.ranking.noise import OutcomeNoise, noise_record
from branchdrive.benchmark.ranking.record import ranking_results

__all__ = ["results_document"]


def results_document(
    protocol: BenchmarkProtocol,
    data: BenchmarkData,
    predictions: PredictionSet,
    risk_fit: RiskFit | None = None,
    noise: OutcomeNoise | None = None,
    *,
    contexts: Contexts | None = None,
    warnings: Sequence[str] = (),
    further_risks: Risks = MappingProxyType({}),
    description: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The document.

    Args:
        protocol: What is compared, and how.
        data: The model layer.
        predictions: Of declared models and of others; models that do not predict the reported partition are left out.
        risk_fit: Learned risk of the guard, from training; the guard is not judged without it.
        noise: How far outcomes move between nominal replays, from training.
        contexts: What baselines see, see `contexts_of`; needed where the protocol declares baselines.
        warnings: Sentences that every table carries, see `warning.warnings`.
        further_risks: Learned risks of further guards, see `Guard.further`.
        description: What is counted of population and models, see `description.describe`; ``None`` to go without.

    Raises:
        DatasetError: The model layer has no group in the partition that is fitted on or reported, or contexts are
            missing.
    """
    inputs = ResultInputs.of(protocol, data, predictions)
    further = further_guard_results(inputs, further_risks, noise)
    return {
        "protocol": {"name": protocol.name, "version": protocol.version, "digest": protocol.digest},
        "warnings": list(warnings),
        "population": {
            "groups": {name: len(part.groups) for name, part in data.parts.items()},
            "clusters": {name: len(set(part.clusters)) for name, part in data.parts.items()},
            "candidates": list(data.candidates),
            "nominal": data.candidates[data.nominal],
        },
        **({} if description is None else {"description": dict(description)}),
        "models": [_model_record(protocol, model, predictions.seeds(model)) for model in inputs.judged],
        "prediction": prediction_results(inputs),
        "diagnostics": diagnostic_results(inputs),
        "ranking": ranking_results(inputs, contexts, noise),
        "guard": guard_results(inputs, risk_fit, noise),
        **({"further_guards": further} if further else {}),
        "noise": None if noise is None else noise_record(noise),
    }


def _model_record(protocol: BenchmarkProtocol, model: str, seeds: Sequence[int]) -> dict[str, Any]:
    declared = protocol.model(model)
    title = model if declared is None else declared.title
    record = {"id": model, "title": title, "seeds": list(seeds), "declared": declared is not None}
    return record | ({"reported_apart": True} if declared is not None and declared.reported_apart else {})
