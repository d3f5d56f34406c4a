"""Action responses as text for people."""

from __future__ import annotations

from rich.console import Console
from rich.text import Text

from branchdrive.engine.response_summary import ResponseSummary
from branchdrive.engine.response_table import response_table
from branchdrive.text.terminal import print_section

__all__ = ["print_response"]


def print_response(console: Console, response: ResponseSummary) -> None:
    """Print what each action did against the nominal, and which columns never change."""
    if not response.actions:
        return
    console.print()
    print_section(console, response_table(response))
    if response.constant:
        listed = ", ".join(f"{name} {value:.4g}" for name, value in sorted(response.constant.items()))
        console.print(Text(f"The same in every observation: {listed}", style="yellow"))
