"""The table of latencies says how models of cameras were timed, where there are some."""

from __future__ import annotations

from typing import Any

from branchdrive.benchmark.latency import latency_table
from branchdrive.contract.document import schema_mismatches

FIGURES = {"median_ms": 1.0, "quantile_95_ms": 2.0}


def document(*models: dict[str, Any]) -> dict[str, Any]:
    return {
        "prediction_lock_digest": "0" * 64,
        "machine": {"processor": "P", "architecture": "x86_64", "device": "cpu", "num_threads": 1},
        "software": {"python": "3.11.0", "numpy": "2.0.0", "torch": "2.0.0"},
        "num_candidates": 13,
        "num_repeats": 2,
        "models": [{"num_seeds": 3, "torch": FIGURES, "exported": None, **model} for model in models],
    }


def test_models_of_cameras_have_a_note_and_others_none() -> None:
    seeing = document({"model": "M3"}, *({"model": name, "reads_cameras": True} for name in ("M4", "M5")))
    blind = document(*({"model": name} for name in ("M3", "M4", "M5")))
    for latency in (seeing, blind):
        assert schema_mismatches(latency, "latency.schema.json") == []
    table, without = latency_table(seeing), latency_table(blind)
    assert (table.rows, [*table.notes[:-1]]) == (without.rows, [*without.notes])
    assert table.notes[-1] == (
        "M4, M5: torch decodes and encodes the 96 images of a window, and its seeds run one after another; "
        "ONNX takes the 6 of a new observation and what it kept of those before, all seeds at once."
    )
