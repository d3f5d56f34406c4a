"""Latency of the locked models: which are timed, and what of the figures can be judged.

Figures are of one machine, and no validator can measure them again; what they are about must agree with the layer.

Source: paper, "Complete-Bank Ranking and Offline Policy Evaluation" (latency of the structured selector);
spec/14-benchmark.md#latency.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from branchdrive.benchmark.protocol import BenchmarkProtocol, DeclaredModel
from branchdrive.contract.comparison import document_mismatches
from branchdrive.contract.mismatch import Mismatch
from branchdrive.driving.feature import InputContract

__all__ = ["WAYS", "latency_mismatches", "timed_models"]

WAYS = ("torch", "exported")
"""How a model ranks: by its networks as they were trained, and as one ONNX model."""


def timed_models(protocol: BenchmarkProtocol) -> list[DeclaredModel]:
    """Models that read no more than a vehicle can know on the road, in the declared order."""
    return [model for model in protocol.models if model.contract == InputContract.SENSOR.value]


def latency_mismatches(
    document: Mapping[str, Any], protocol: BenchmarkProtocol, *, prediction_lock_digest: str, num_candidates: int
) -> Iterator[Mismatch]:
    """Where latencies are not of the locked models, or contradict themselves.

    Args:
        document: ``latency.json``, which conforms to its schema.
        protocol: Of the layer.
        prediction_lock_digest: SHA-256 of the stored ``lock.json``.
        num_candidates: Of the bank.
    """
    expected = {
        "prediction_lock_digest": prediction_lock_digest,
        "num_candidates": num_candidates,
        "models": [{"model": model.id, "num_seeds": len(model.seeds)} for model in timed_models(protocol)],
    }
    models = [{name: entry[name] for name in ("model", "num_seeds")} for entry in document["models"]]
    yield from document_mismatches(expected, {**{name: document[name] for name in expected}, "models": models})
    for i, entry in enumerate(document["models"]):
        for way in WAYS:
            found = entry[way]
            if found is not None and found["median_ms"] > found["quantile_95_ms"]:
                yield Mismatch(
                    {"pointer": f"/models/{i}/{way}/median_ms"},
                    f"at most the 95 % quantile, {found['quantile_95_ms']:g}",
                    f"{found['median_ms']:g}",
                )
