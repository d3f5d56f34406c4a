"""Results of a benchmark on a terminal: the headline tables, each with the warnings of the results."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, TextIO

from rich.console import Console
from rich.text import Text

from branchdrive.benchmark.tables import result_sections
from branchdrive.text.table import Table
from branchdrive.text.terminal import print_section, render

__all__ = ["render_results"]


def render_results(results: Mapping[str, Any], stdout: TextIO) -> str:
    """Prediction, comparisons, ranking and guard as text, coloured if `stdout` is a terminal."""
    return render(partial(_print_results, results=results), stdout)


def _print_results(console: Console, results: Mapping[str, Any]) -> None:
    for section in result_sections(results):
        if isinstance(section, Table):
            if section.is_detail or not section.rows:
                continue
            section = section.without_details()
        print_section(console, section, results["warnings"])
        console.print()
    if results["noise"] is None:
        console.print(
            Text(
                "Noise of outcomes: unknown; the ranking lock holds none, which takes nominal replays in the raw layer."
            )
        )
    console.print(Text("These are the headlines; --format markdown prints all tables.", style="dim"))
