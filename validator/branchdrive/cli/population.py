"""Population, retention and leakage of a release as text for people.

Every function prints on a console of any width from 80 columns on, in printable ASCII.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.box import Box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from branchdrive.contract.text import percent, printable
from branchdrive.leakage.text import leakage_sentences
from branchdrive.quality.ledger import RELEASE_ACCESS, accesses
from branchdrive.quality.text import UNITS, access_sentence, benchmark_sentences, population_sentences

__all__ = ["print_accesses", "print_leakage", "print_population", "print_retention"]

Document = Mapping[str, Any]

_HEADS = {"train": "Train", "val": "Val", "test": "Test", "calibration": "Calib."}
_UNIT_HEADS = {"pair": "pairs", "bank": "banks"}
_VERDICT_STYLE = {"pass": "bold green", "fail": "bold red", "inconclusive": "bold yellow"}

_RULED = Box("    \n    \n -- \n    \n -- \n -- \n    \n    \n", ascii=True)
"""Rules of dashes below the head and between sections, and nothing else."""


def print_population(console: Console, population: Document) -> None:
    """The population table: groups at each stage by partition, in total, and trajectories."""
    names = population["partitions"]
    table = _table("Population")
    table.add_column("Stage", no_wrap=True)
    for head in (*(_HEADS[name] for name in names), "Total", "Traj."):
        table.add_column(head, justify="right", no_wrap=True)
    for stage in population["stages"]:
        groups = stage["groups"] or {}
        cells = [*(_count(groups.get(name)) for name in names), _count(stage["total"]), _count(stage["trajectories"])]
        is_frozen = stage["stage"] == "frozen"
        if is_frozen:
            table.add_section()
        table.add_row(Text(printable(stage["title"])), *cells, style="bold" if is_frozen else "")
    console.print(table)
    console.print(
        Text(f"Traj. = groups x {population['num_policies']} candidates; not independent samples", style="dim")
    )
    for sentence in population_sentences(population):
        console.print(Text(sentence, style="yellow"))


def print_retention(console: Console, retention: Document) -> None:
    """Pairs and banks that pass in each partition, with intervals and predeclared targets."""
    table = _table("Replay fidelity")
    for head in ("Criterion", "Partition", "Unit"):
        table.add_column(head, no_wrap=True)
    for head in ("Passed", "Share", f"{percent(retention['level'], 0)} interval"):
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("Target", no_wrap=True)
    criterion = partition = None
    for row in retention["rows"]:
        if criterion not in (None, row["criterion"]):
            table.add_section()
        new_criterion = row["criterion"] != criterion
        new_partition = new_criterion or row["partition"] != partition
        criterion, partition = row["criterion"], row["partition"]
        share, interval = "-", "-"
        if row["share"] is not None:
            share, interval = percent(row["share"]), f"{percent(row['low']).rstrip('%')} - {percent(row['high'])}"
        table.add_row(
            criterion if new_criterion else "",
            _HEADS[row["partition"]].lower() if new_partition else "",
            _UNIT_HEADS[row["unit"]],
            f"{row['num_passed']:,}/{row['num_units']:,}",
            share,
            interval,
            Text.assemble(f"{percent(row['target'], 0)} ", _verdict_of(row["met"])),
        )
    console.print(table)
    for row in retention["rows"]:
        if row["criterion"] == "core" and row["partition"] == "test" and row["met"] is False:
            missed = f"Missed on test: {percent(row['share'])} of {UNITS[row['unit']]} pass the core criteria, "
            console.print(Text(f"{missed}target {percent(row['target'], 0)}", style="yellow"))


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


def _table(title: str) -> Table:
    return Table(
        title=title, title_justify="left", title_style="bold", box=_RULED, show_edge=False, pad_edge=False,
        collapse_padding=True,        header_style="bold",
    )  # fmt: skip


def _verdict_of(met: bool | None) -> Text:
    if met is None:
        return Text("not judged", style="yellow")
    return Text("met", style="green") if met else Text("missed", style="bold red")


def _count(count: int | None) -> str:
    return "-" if count is None else f"{count:,}"
