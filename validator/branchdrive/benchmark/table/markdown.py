"""A table in Markdown with what all tables share: warnings below its title, and how numbers are written.

Source: spec/14-benchmark.md#tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

__all__ = [
    "BCA", "BY_CLUSTERS", "NONE", "Document", "Rows", "ends_of", "number", "plain", "spread_over_seeds", "table",
]  # fmt: skip

Document = Mapping[str, Any]
Rows = list[list[str]]

NONE = "-"
"""Stands where a value is not defined."""

BY_CLUSTERS = ("cluster_low", "cluster_high")
BCA = ("bca_low", "bca_high")
"""Ends of intervals beside those that resample groups."""

_ESCAPED = str.maketrans({"|": "\\|", "<": "&lt;"})


def table(
    title: str, results: Document, header: Sequence[str], rows: Rows, notes: Sequence[str] = (), left: int = 1
) -> list[str]:
    """A titled table with the warnings of the results; the first `left` columns are texts."""
    lines = [f"## {title}", ""]
    for warning in results["warnings"]:
        lines += [f"> **Warning.** {plain(warning)}", ""]
    rule = ["---"] * left + ["--:"] * (len(header) - left)
    lines += [_line(header), _line(rule), *(_line(row) for row in rows)]
    return [*lines, *(line for note in notes for line in ("", note))]


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def plain(text: str) -> str:
    """Text of others, which the schema keeps on one line, without a cell or a tag of its own."""
    return text.translate(_ESCAPED)


def number(value: float | None, digits: int = 3) -> str:
    """A number with so many digits, without a sign before zero."""
    return NONE if value is None else f"{round(value, digits) + 0.0:.{digits}f}"


def spread_over_seeds(value: float | None, seed_sd: float | None) -> str:
    """A mean with its standard deviation over seeds, if there are several."""
    return number(value) if seed_sd is None or value is None else f"{number(value)} ± {number(seed_sd)}"


def ends_of(interval: Document, low: str = "low", high: str = "high") -> str:
    """An interval."""
    if interval[low] is None or interval[high] is None:
        return NONE
    return f"[{number(interval[low])}, {number(interval[high])}]"
