"""Numbers of results as JSON data: what is unknown is null, and what is infinite too."""

from __future__ import annotations

import math
from collections.abc import Iterable

__all__ = ["number", "numbers"]


def number(value: float | None) -> float | None:
    """A finite number, or ``None``."""
    return None if value is None or not math.isfinite(value) else float(value)


def numbers(values: Iterable[float]) -> list[float | None]:
    """Finite numbers, ``None`` for others."""
    return [number(value) for value in values]
