"""Results of a benchmark on a terminal: a screen of headlines, with the warnings of the results."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, TextIO

from rich.console import Console
from rich.text import Text

from branchdrive.benchmark.table.headline import headline_sections, inconclusive_sentence
from branchdrive.contract.text import printable
from branchdrive.text.terminal import print_section, render

__all__ = ["render_results"]


def render_results(results: Mapping[str, Any], stdout: TextIO, *, tables: str | None = None) -> str:
    """Prediction, regret of selections and guard as text, coloured if `stdout` is a terminal.

    Args:
        results: Document ``results.json``, which conforms to its schema.
        stdout: Where the text is to go.
        tables: Path of all tables, if they are in a file.
    """
    return render(partial(_print_results, results=results, tables=tables), stdout)


def _print_results(console: Console, results: Mapping[str, Any], tables: str | None) -> None:
    if (sentence := inconclusive_sentence(results)) is not None:
        console.print(Text(sentence, style="yellow"))
        console.print()
    for warning in results["warnings"]:
        console.print(Text(f"Warning: {printable(warning)}", style="yellow"))
    if results["warnings"]:
        console.print()
    for section in headline_sections(results):
        print_section(console, section)
        console.print()
    said = "These are the headlines; --format markdown prints all tables"
    console.print(Text(f"{said}." if tables is None else f"{said}, which are in {printable(tables)}.", style="dim"))
