"""Whole numbers as short text: what `decode.js` reads.

Numbers are written as differences, differences as bytes of seven bits, the lowest first, the sign in the lowest bit;
a zero is followed by how many more zeros come. Bytes are text of base 64. No compression library takes part, whose
bytes might change with its version.
"""

from __future__ import annotations

import base64

import numpy as np
from numpy.typing import NDArray

__all__ = ["LARGEST", "MISSING", "Packer", "quantised"]

LARGEST = 2**29
"""No packed number is larger."""

MISSING = -(2**30)
"""Stands for a value that is absent or no number."""


def quantised(values: NDArray[np.float64], step: float) -> NDArray[np.int64]:
    """Values in whole steps; `MISSING` where one is not finite or too large.

    >>> quantised(np.array([0.5, np.nan]), 0.25).tolist() == [2, MISSING]
    True
    """
    with np.errstate(all="ignore"):
        steps = np.rint(values / step)
        is_number = np.abs(steps) <= LARGEST
    return np.where(is_number, np.where(is_number, steps, 0.0), MISSING).astype(np.int64)


class Packer:
    """Packs one series after the other; a reader takes them in the same order."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def add(self, values: NDArray[np.int64], *, order: int = 1) -> None:
        """Pack a series.

        Args:
            values: Whole numbers ``[n]``; a reader has to know ``n``.
            order: Differences that are taken: 1 for values that mostly stay, 2 for those that mostly keep their pace.
        """
        numbers, write, num_more = values.tolist(), self._bytes.append, -1
        for _ in range(order):
            numbers = [number - before for number, before in zip(numbers, [0, *numbers], strict=False)]
        for number in numbers:
            if number == 0:
                num_more += 1
                continue
            if num_more >= 0:
                self._write_zeros(num_more)
                num_more = -1
            token = 2 * number if number > 0 else -2 * number - 1
            while token > 0x7F:
                write(0x80 | (token & 0x7F))
                token >>= 7
            write(token)
        if num_more >= 0:
            self._write_zeros(num_more)

    def _write_zeros(self, num_more: int) -> None:
        """A zero, and how many more there are."""
        self._bytes.append(0)
        while num_more > 0x7F:
            self._bytes.append(0x80 | (num_more & 0x7F))
            num_more >>= 7
        self._bytes.append(num_more)

    def text(self) -> str:
        """Everything that was packed, as text of base 64."""
        return base64.b64encode(self._bytes).decode("ascii")
