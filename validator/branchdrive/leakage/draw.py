"""How random draws of an audit are divided: ranges of streams whose numbers depend on seed and place alone.

Every range gives the same numbers wherever it is computed, so that who computes it is left to the caller; so is where
large values are kept that ranges are drawn from.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

__all__ = ["ONCE", "Draw", "Kept", "KeptHere", "Workplace", "drawn_here", "ranges_of"]

Drawn = TypeVar("Drawn")
Made = TypeVar("Made")
Told = TypeVar("Told")
Value = TypeVar("Value")
Held = TypeVar("Held", covariant=True)

_MAX_RANGES = 64

ONCE = (range(1),)
"""The ranges of what is computed once."""


class Kept(Protocol[Held]):
    """A value that is kept somewhere, and taken from there by who computes with it."""

    @property
    def value(self) -> Held:
        """The value."""
        ...


@dataclass(frozen=True, eq=False)
class KeptHere(Generic[Value]):
    """A value in this process.

    Attributes:
        value: The value.
    """

    value: Value


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


class Workplace(Draw, Protocol):
    """A draw that also keeps what is drawn from."""

    def keep(self, make: Callable[[Any], tuple[Made, Told]], subject: Any, /) -> tuple[Kept[Made], Told]:
        """A value that is made where it is kept, and what is reported of it.

        Args:
            make: Of a module of this distribution; gives both.
            subject: What it is a function of; pickled for other processes.
        """
        ...


class _Here:
    """This process, for all that is computed."""

    def __call__(
        self, function: Callable[[Any, range], Drawn], subject: Any, ranges: Sequence[range], /
    ) -> list[Drawn]:
        return [function(subject, each) for each in ranges]

    def keep(self, make: Callable[[Any], tuple[Made, Told]], subject: Any, /) -> tuple[Kept[Made], Told]:
        made, told = make(subject)
        return KeptHere(made), told


drawn_here: Workplace = _Here()
"""Computes everything in this process."""


def ranges_of(count: int, unit: int) -> list[range]:
    """Ranges of the numbers below a count, of whole units but for the last; at most 64 of them."""
    length = unit * max(1, -(-count // (unit * _MAX_RANGES)))
    return [range(first, min(first + length, count)) for first in range(0, count, length)]
