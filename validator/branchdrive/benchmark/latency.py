"""Latency of the locked models: which are timed, what of the figures can be judged, and their table.

Figures are of one machine, and no validator can measure them again; what they are about must agree with the layer.

Source: paper, "Complete-Bank Ranking and Offline Policy Evaluation" (latency of the structured selector);
spec/14-benchmark.md#latency.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from branchdrive.benchmark.cell import Document
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol, DeclaredModel
from branchdrive.benchmark.protocol.rules import protocol_of
from branchdrive.benchmark.view import digest_of
from branchdrive.contract.columns import STREAMS
from branchdrive.contract.comparison import document_mismatches
from branchdrive.contract.layout import LATENCY_FILE, LOCK_FILE
from branchdrive.contract.mismatch import Check, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.contract.text import NONE, counted
from branchdrive.contract.timing import HISTORY_OBSERVATIONS
from branchdrive.driving.feature import InputContract
from branchdrive.layers.compare import document_check
from branchdrive.layers.view import ReleaseView
from branchdrive.text.table import Column, Table

__all__ = ["WAYS", "latency_mismatches", "latency_table", "timed_models"]

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


@rule("BD-BMK-016")
def latencies_are_of_the_locked_models(view: ReleaseView) -> Iterator[Check]:
    """Latencies are of the stored lock, the bank, and the models of the protocol, and agree in themselves."""
    if LATENCY_FILE not in view.files:
        return
    document, bank = view.document(LATENCY_FILE), view.descriptor.action_bank
    mismatches = latency_mismatches(
        document,
        view.cached(protocol_of),
        prediction_lock_digest=digest_of(view, LOCK_FILE),
        num_candidates=len(bank.keys),
    )
    yield document_check(LATENCY_FILE, max(1, len(document["models"])), mismatches)


_FIGURES = ("median_ms", "quantile_95_ms")
_CAMERAS = len(STREAMS["rgb_surround"].cameras)


def latency_table(latency: Document) -> Table:
    """Median and 95 % quantile of every model.

    Args:
        latency: Document ``latency.json``, which conforms to its schema.
    """
    rows = [
        [entry["model"], str(entry["num_seeds"]), *(_cell(entry[way], name) for way in WAYS for name in _FIGURES)]
        for entry in latency["models"]
    ]
    machine, software = latency["machine"], latency["software"]
    processor = machine["processor"] or "a processor without a name"
    versions = ", ".join(f"{name} {software[name]}" for name in sorted(software))
    notes = [
        f"Time to rank {latency['num_candidates']} candidates of one context with all seeds of a model, over "
        f"{counted(latency['num_repeats'], 'ranking')}: the networks in torch, and the model exported to ONNX.",
        f"Measured on one machine and not recomputed by a validator: {processor} ({machine['architecture']}), "
        f"device {machine['device']}, {counted(machine['num_threads'], 'thread')}; {versions}.",
    ]
    if seeing := [entry["model"] for entry in latency["models"] if "reads_cameras" in entry]:
        notes.append(
            f"{', '.join(seeing)}: torch decodes and encodes the {_CAMERAS * HISTORY_OBSERVATIONS} images of a window, "
            f"and its seeds run one after another; ONNX takes the {_CAMERAS} of a new observation and what it kept of "
            "those before, all seeds at once."
        )
    columns = [
        Column.name("Model"), Column("Seeds"), Column("torch: median, ms"), Column("torch: 95 %, ms"),
        Column("ONNX: median, ms"), Column("ONNX: 95 %, ms"),
    ]  # fmt: skip
    return Table("Latency", columns, rows, notes)


def _cell(found: Document | None, name: str) -> str:
    return NONE if found is None else f"{found[name]:.2f}"
