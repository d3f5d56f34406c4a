"""Population, retention and leakage of a release as text for people.

Every function prints on a console of any width, in printable ASCII.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.padding import Padding
from rich.text import Text

from branchdrive.contract.text import NONE, count_text, percent, printable
from branchdrive.leakage.text import leakage_sentences
from branchdrive.quality.ledger import RELEASE_ACCESS, accesses
from branchdrive.quality.text import (
    UNITS,
    access_sentence,
    benchmark_sentences,
    filtering_sentences,
    population_sentences,
)
from branchdrive.text.table import Column, Table
from branchdrive.text.terminal import print_section

__all__ = [
    "population_table", "print_accesses", "print_filtering", "print_leakage", "print_population", "print_retention",
    "retention_table",
]  # fmt: skip

Document = Mapping[str, Any]

_HEADS = {"train": "Train", "val": "Val", "test": "Test", "calibration": "Calib."}
_UNIT_HEADS = {"pair": "pairs", "bank": "banks"}
_VERDICT_STYLE = {"pass": "bold green", "fail": "bold red", "inconclusive": "bold yellow"}


def population_table(population: Document) -> Table:
    """Groups at each stage by partition, in total, and trajectories."""
    names = population["partitions"]
    rows = [
        [
            stage["title"],
            *(count_text((stage["groups"] or {}).get(name)) for name in names),
            count_text(stage["total"]),
            count_text(stage["trajectories"]),
        ]
        for stage in population["stages"]
    ]
    columns = [Column.name("Stage"), *map(Column, (*(_HEADS[name] for name in names), "Total", "Traj."))]
    note = f"Traj. = groups x {population['num_policies']} candidates; not independent samples"
    return Table("Population", columns, rows, [note], has_total=True)


def print_population(console: Console, population: Document) -> None:
    """The population table, and what it does not say by itself."""
    print_section(console, population_table(population))
    for sentence in population_sentences(population):
        console.print(Text(sentence, style="yellow"))


def retention_table(retention: Document) -> Table:
    """Pairs and banks that pass in each partition, with intervals and predeclared targets."""
    columns = [
        *map(Column.name, ("Criterion", "Partition", "Unit")),
        *map(Column, ("Passed", "Share", f"{percent(retention['level'], 0)} interval")),
        Column("Target", is_text=True),
    ]
    return Table("Replay fidelity", columns, [_retained(row) for row in retention["rows"]])


def print_retention(console: Console, retention: Document) -> None:
    """The table of retention, and which targets are missed."""
    print_section(console, retention_table(retention))
    for row in retention["rows"]:
        if row["criterion"] == "core" and row["partition"] == "test" and row["met"] is False:
            missed = f"Missed on test: {percent(row['share'])} of {UNITS[row['unit']]} pass the core criteria, "
            console.print(Text(f"{missed}target {percent(row['target'], 0)}", style="yellow"))


def print_filtering(console: Console, filtering: Document) -> None:
    """Which thresholds of replay fidelity filter nothing, and what matching by actor changes."""
    for sentence in filtering_sentences(filtering):
        console.print(Padding(Text(printable(sentence)), (0, 0, 0, 2)))


def print_leakage(console: Console, leakage: Document | None) -> None:
    """Verdict of the leakage gate with its minimum detectable effect, or that leakage was not audited."""
    verdict = "not audited" if leakage is None else leakage["gate"]["verdict"]
    console.print(Text.assemble(("Leakage: ", "bold"), (verdict, _VERDICT_STYLE.get(verdict, "yellow"))))
    for sentence in leakage_sentences(leakage):
        console.print(Padding(Text(printable(sentence)), (0, 0, 0, 2)))


def print_accesses(console: Console, ledger: Document) -> None:
    """How often the test partition was accessed, for this release and for benchmarks before it."""
    is_untouched = len(accesses(RELEASE_ACCESS, ledger)) <= 1
    console.print(Text(access_sentence(ledger), style="" if is_untouched else "bold yellow"))
    for sentence in benchmark_sentences(ledger):
        console.print(Text(sentence, style="bold yellow"))


def _retained(row: Document) -> list[str]:
    share, interval = NONE, NONE
    if row["share"] is not None:
        share, interval = percent(row["share"]), f"{percent(row['low']).rstrip('%')} - {percent(row['high'])}"
    met = "not judged" if row["met"] is None else "met" if row["met"] else "missed"
    return [
        row["criterion"],
        _HEADS[row["partition"]].lower(),
        _UNIT_HEADS[row["unit"]],
        f"{row['num_passed']:,}/{row['num_units']:,}",
        share,
        interval,
        f"{percent(row['target'], 0)} {met}",
    ]
