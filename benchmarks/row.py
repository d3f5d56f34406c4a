"""A row of the table that the benchmarks print."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["Row"]


class Row(NamedTuple):
    """What was measured, what came out, and the bar it is compared with; empty where there is none."""

    what: str
    measured: str
    bar: str = ""
