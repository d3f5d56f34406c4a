"""Choices of one case of the fuzz: random words of the specification, so that a case is the same on every machine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from branchdrive.statistics.random_words import below, words

__all__ = ["Draw"]

T = TypeVar("T")

_WORDS_PER_ROW = 64


class Draw:
    """Choices from the stream of the case `index` under a seed."""

    def __init__(self, seed: int, index: int) -> None:
        self._seed, self._name = seed, f"fuzz/case/{index}"
        self._next = 0

    def below(self, limit: int) -> int:
        """A number ``0 .. limit - 1``."""
        row, place = divmod(self._next, _WORDS_PER_ROW)
        self._next += 1
        if place == 0:
            self._row = words(self._seed, self._name, 1, _WORDS_PER_ROW, first_row=row)[0]
        return int(below(self._row[place : place + 1], limit)[0])

    def choice(self, values: Sequence[T]) -> T:
        """One of several values."""
        return values[self.below(len(values))]

    def bytes(self, size: int) -> bytes:
        """Random bytes."""
        return bytes(self.below(256) for _ in range(size))
