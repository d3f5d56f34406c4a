"""What an action costs: seconds on the clock, and seconds of processors in this process and those it starts."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

__all__ = ["Cost", "cost_of"]


@dataclass(frozen=True)
class Cost:
    """Seconds on the clock, and of processors; that of a process which still runs is not in."""

    wall_s: float
    cpu_s: float

    @classmethod
    def median(cls, costs: Sequence[Cost]) -> Cost:
        """Medians of both, each by itself."""
        return cls(statistics.median(cost.wall_s for cost in costs), statistics.median(cost.cpu_s for cost in costs))

    def __sub__(self, other: Cost) -> Cost:
        return Cost(self.wall_s - other.wall_s, self.cpu_s - other.cpu_s)

    def __str__(self) -> str:
        return f"{self.wall_s:.2f} s ({self.cpu_s:.2f} CPU-s)"

    def over(self, floor: Cost) -> str:
        """Both as multiples of what a floor costs."""
        return f"{self.wall_s / floor.wall_s:.2f}x ({self.cpu_s / floor.cpu_s:.2f}x CPU)"


def cost_of(action: Callable[[], object]) -> Cost:
    """Run an action, whose processes have ended when it returns."""
    before, start_s = os.times(), time.perf_counter()
    action()
    wall_s, after = time.perf_counter() - start_s, os.times()
    return Cost(wall_s, sum(after[:4]) - sum(before[:4]))
