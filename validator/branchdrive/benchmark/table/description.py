"""Tables of what a benchmark is about: scenario types and towns, available targets.

Source: spec/14-benchmark.md#results.
"""

from __future__ import annotations

from branchdrive.benchmark.table.cell import Document
from branchdrive.contract.text import NONE
from branchdrive.driving.target import TARGETS
from branchdrive.quality.text import PARTITION_TITLES
from branchdrive.text.table import Column, Table

__all__ = ["description_tables", "parameter_texts"]


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
