"""What a benchmark is about, in counts: scenario types and towns, available targets, numbers that models have learned.

Source: paper, "Research Questions and Experimental Protocol" (scenario types, towns, available times to collision) and
its table of models (parameters); spec/14-benchmark.md#results.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from branchdrive.benchmark.data import BenchmarkData
from branchdrive.tables.frame import Frame

__all__ = ["describe", "described_checkpoints"]


def describe(contexts: Frame, data: BenchmarkData, parameters: Mapping[str, int]) -> dict[str, Any]:
    """The section ``description``.

    Args:
        contexts: Frame of the table `contexts`.
        data: Of the same model layer.
        parameters: Numbers in the checkpoint of each locked model.
    """
    return {
        "scenario_types": _groups_of(contexts, "scenario_type"),
        "towns": _groups_of(contexts, "town"),
        "availability": [
            {
                "partition": name,
                "num_candidates": int(part.outcomes.available[..., 0].size),
                "available": part.outcomes.available.sum(axis=(0, 1)).tolist(),
            }
            for name, part in data.parts.items()
        ],
        "parameters": [{"model": model, "num_parameters": parameters[model]} for model in sorted(parameters)],
    }


def _groups_of(contexts: Frame, column: str) -> list[dict[str, Any]]:
    """Groups of every value of a column, by partition."""
    found: dict[str, dict[str, int]] = {}
    pairs = Counter(zip(contexts[column].tolist(), contexts["partition"].tolist(), strict=True))
    for (name, partition), count in sorted(pairs.items()):
        found.setdefault(name, {})[partition] = count
    return [{"name": name, "groups": groups} for name, groups in found.items()]


def described_checkpoints(lock: Mapping[str, Any]) -> dict[str, str]:
    """The checkpoint whose numbers are counted for each locked model, that of its least seed: its path in the layer."""
    entries = sorted(lock["checkpoints"], key=lambda entry: int(entry["seed"]), reverse=True)
    return {entry["model"]: entry["file"] for entry in entries}
