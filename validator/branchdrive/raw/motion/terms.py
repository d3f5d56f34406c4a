"""Terms of the quantities of calibration: what is summed over the steps of an attempt.

Source: spec/07-rules.md#calibration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mask

__all__ = ["Steps", "Terms"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Terms(NamedTuple):
    """What is compared for a quantity, by step.

    Attributes:
        row: Observation that each step leads to ``[terms]``.
        parts: Terms of the sums that make the quantity, each ``[terms]``: upper and lower sum, or those of a lead. The
            second is the weight of each step.
    """

    row: Index
    parts: tuple[Array, ...]

    def take(self, chosen: Index) -> Terms:
        """Those in the chosen places."""
        return Terms(self.row[chosen], tuple(part[chosen] for part in self.parts))


class Steps(NamedTuple):
    """Steps between neighbouring observations, of the ego or of actors.

    Attributes:
        row: Observation that each leads to ``[steps]``.
        place: The distinct step that each is or repeats, -1 where that says nothing ``[steps]``.
    """

    row: Index
    place: Index

    def terms(self, counts: Mask, above: Array, below: Array) -> Terms:
        """Terms of the steps that count, from those of distinct steps ``[distinct]``."""
        counts = np.append(counts & np.isfinite(above) & np.isfinite(below), False)
        chosen = np.flatnonzero(counts[self.place])
        place = self.place[chosen]
        return Terms(self.row[chosen], (above[place], below[place]))

    def slope(self, counts: Mask, recorded: Array, known: Array) -> Terms:
        """Terms of the slope of recorded values on those that are known ``[distinct]``."""
        return self.terms(counts, recorded * known, known**2)
