"""What is driven in every group: a selector, under a schedule, in a condition."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from branchdrive_reference.closed_loop.course import Schedule
from branchdrive_reference.closed_loop.selector import NOMINAL

__all__ = ["CONDITIONS", "Arm", "Condition", "arms_of"]


@dataclass(frozen=True)
class Condition:
    """Noise of a drive, in strengths.

    Attributes:
        name: ``exact``, ``replay noise`` or ``sensor noise``.
        replay: Of the noise of replays.
        sensor: Of the noise on histories.
    """

    name: str
    replay: float = 0.0
    sensor: float = 0.0


CONDITIONS = ("exact", "replay noise", "sensor noise")
"""Names of conditions in their order."""


@dataclass(frozen=True)
class Arm:
    """One arm; the drives of a group under all arms share its seeds.

    Attributes:
        selector: Name of the selector.
        schedule: When it decides.
        condition: Noise.
    """

    selector: str
    schedule: Schedule
    condition: Condition

    @property
    def is_nominal(self) -> bool:
        """Whether others are held against it."""
        return self.selector == NOMINAL

    @property
    def document(self) -> dict[str, Any]:
        """The arm as a lock has it."""
        return {
            "selector": self.selector,
            "every_ticks": self.schedule.every_ticks,
            "num_decisions": self.schedule.num_decisions,
            "condition": self.condition.name,
            "replay_noise": self.condition.replay,
            "sensor_noise": self.condition.sensor,
        }


def arms_of(selectors: Sequence[str], schedules: Sequence[Schedule], conditions: Sequence[Condition]) -> list[Arm]:
    """Every selector, nominal among them, under every schedule in every condition."""
    return [Arm(name, schedule, condition) for condition in conditions for schedule in schedules for name in selectors]
