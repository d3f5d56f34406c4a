"""How cells of a benchmark's tables are written: numbers, intervals, spreads over seeds.

Source: spec/14-benchmark.md#tables.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from branchdrive.contract.text import NONE

__all__ = ["BCA", "BY_CLUSTERS", "Document", "ends_of", "number", "signed", "spread_over_seeds", "with_ends"]

Document = Mapping[str, Any]

BY_CLUSTERS = ("cluster_low", "cluster_high")
BCA = ("bca_low", "bca_high")
"""Ends of intervals beside those that resample groups."""


def number(value: float | None, digits: int = 3) -> str:
    """A number with so many digits, without a sign before zero."""
    return NONE if value is None else f"{round(value, digits) + 0.0:.{digits}f}"


def signed(value: float) -> str:
    """A difference, always with its sign."""
    return f"{round(value, 3) + 0.0:+.3f}"


def spread_over_seeds(value: float | None, seed_sd: float | None) -> str:
    """A mean with its standard deviation over seeds, if there are several."""
    return number(value) if seed_sd is None or value is None else f"{number(value)} ± {number(seed_sd)}"


def ends_of(interval: Document, low: str = "low", high: str = "high") -> str:
    """An interval."""
    if interval[low] is None or interval[high] is None:
        return NONE
    return f"[{number(interval[low])}, {number(interval[high])}]"


def with_ends(text: str, interval: Document) -> str:
    """A number with its interval, if there is one."""
    return text if text == NONE else f"{text} {ends_of(interval)}".removesuffix(f" {NONE}")
