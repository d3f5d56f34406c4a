"""What was recorded of whole drives of complete banks, up to their ends.

``N`` groups, ``A`` candidates in the order of the bank. Source: spec/12-model.md#endings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["EVENTS", "Endings"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]

EVENTS = ("collision", "off_road", "infraction")
"""Events of a drive, the columns of the table `endings`; a drive without any of them is clean."""


@dataclass(frozen=True, eq=False)
class Endings:
    """What was recorded of whole drives: the window, and what the expert's policy made of it afterwards.

    Attributes:
        events: ``[N, A, 3]``, in the order of `EVENTS`; false where not monitored.
        monitored: ``[N, A, 3]``.
        completed: Whether the route was completed ``[N, A]``.
        route_fraction: Share of the route's length that was driven ``[N, A]``.
    """

    events: Mask
    monitored: Mask
    completed: Mask
    route_fraction: Array

    @property
    def is_known(self) -> Mask:
        """Where it is known whether a drive is clean ``[N, A]``: all its events were monitored."""
        return np.asarray(self.monitored.all(axis=2))

    @property
    def is_clean(self) -> Mask:
        """Which drives are known to be clean to their end ``[N, A]``."""
        return np.asarray(self.is_known & ~self.events.any(axis=2))

    def take(self, groups: Index | Mask | slice) -> Endings:
        """Endings of these groups, in this order."""
        return Endings(self.events[groups], self.monitored[groups], self.completed[groups], self.route_fraction[groups])
