"""How random draws of an audit are divided: ranges of streams whose numbers depend on seed and place alone.

Every range gives the same numbers wherever it is computed, so that who computes it is left to the caller.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeVar

__all__ = ["Draw", "drawn_here", "ranges_of"]

Drawn = TypeVar("Drawn")

_MAX_RANGES = 64


class Draw(Protocol):
    """Computes a function of a subject over ranges; results in the order of the ranges."""

    def __call__(
        self, function: Callable[[Any, range], Drawn], subject: Any, ranges: Sequence[range], /
    ) -> list[Drawn]:
        """Results of all ranges.

        Args:
            function: Of a module of this distribution.
            subject: What it is a function of beside the range; pickled for other processes, once.
            ranges: Numbers of what is drawn.
        """
        ...


def drawn_here(function: Callable[[Any, range], Drawn], subject: Any, ranges: Sequence[range], /) -> list[Drawn]:
    """Results of all ranges, computed in this process."""
    return [function(subject, each) for each in ranges]


def ranges_of(count: int, unit: int) -> list[range]:
    """Ranges of the numbers below a count, of whole units but for the last; at most 64 of them."""
    length = unit * max(1, -(-count // (unit * _MAX_RANGES)))
    return [range(first, min(first + length, count)) for first in range(0, count, length)]
