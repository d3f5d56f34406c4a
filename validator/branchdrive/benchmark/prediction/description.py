"""What a benchmark is about, in counts: scenario types and towns, available targets, numbers that models have learned.

Counts of the section `description` of results, and their tables.

Source: paper, "Research Questions and Experimental Protocol" (scenario types, towns, available times to collision) and
its table of models (parameters); spec/14-benchmark.md#results.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from branchdrive.benchmark.cell import Document
from branchdrive.benchmark.prediction.data import BenchmarkData
from branchdrive.contract.text import NONE
from branchdrive.driving.target import TARGETS
from branchdrive.quality.text import PARTITION_TITLES
from branchdrive.tables.frame import Frame
from branchdrive.text.table import Column, Table

__all__ = ["describe", "described_checkpoints", "description_tables", "parameter_texts"]


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


def description_tables(results: Document) -> list[Table]:
    """Composition and availability; none where results have no description."""
    if "description" not in results:
        return []
    about, partitions = (
        results["description"],
        [name for name in PARTITION_TITLES if name in results["population"]["groups"]],
    )
    rows = [
        [kind, found["name"], *(f"{found['groups'].get(name, 0):,}" for name in partitions)]
        for kind, section in (("scenario type", "scenario_types"), ("town", "towns"))
        for found in about[section]
    ]
    titles = [Column(PARTITION_TITLES[name]) for name in partitions]
    composition = Table(
        "Composition of the population", [Column.name("Kind"), Column.name("Name"), *titles], rows,
        ["Groups of the frozen population."],
    )  # fmt: skip
    counts = {found["partition"]: found for found in about["availability"]}
    there = [name for name in PARTITION_TITLES if name in counts]
    rows = [
        [PARTITION_TITLES[name], f"{counts[name]['num_candidates']:,}", *(f"{n:,}" for n in counts[name]["available"])]
        for name in there
    ]
    heads = [Column.name("Partition"), Column("Candidates"), *(Column(target.symbol) for target in TARGETS)]
    note = "Candidates whose target is available; what is not stays masked in errors, ranks and means."
    return [composition, Table("Availability of targets", heads, rows, [note])]


def parameter_texts(results: Document) -> dict[str, str] | None:
    """Millions of numbers in the checkpoint of each model, ``None`` where results have no description."""
    if "description" not in results:
        return None
    known = {row["model"]: f"{row['num_parameters'] / 1e6:.3f}" for row in results["description"]["parameters"]}
    return {model["id"]: known.get(model["id"], NONE) for model in results["models"]}
