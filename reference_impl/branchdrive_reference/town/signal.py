"""Traffic lights: a fixed programme of two groups of approaches, a pure function of the tick.

One cycle, in ticks: group 0 is green, then yellow; everything is red; group 1 is green, then yellow; everything
is red. A world chooses where in the cycle it begins.

Weather and light conditions, as far as the vehicle feels them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from types import MappingProxyType

from branchdrive_reference.kernel import kernel

__all__ = [
    "CYCLE_TICKS",
    "ENVIRONMENTS",
    "NO_GROUP",
    "Environment",
    "Light",
    "approach_group",
    "green_begins",
    "light_of",
]

NO_GROUP = -1

_GREEN_TICKS, _YELLOW_TICKS, _ALL_RED_TICKS = 200, 60, 30
_HALF_TICKS = _GREEN_TICKS + _YELLOW_TICKS + _ALL_RED_TICKS
CYCLE_TICKS = 2 * _HALF_TICKS


class Light(IntEnum):
    """State of a signal; names in lower case are the values of ``traffic_light``."""

    GREEN = 0
    YELLOW = 1
    RED = 2


_GREEN, _YELLOW, _RED = int(Light.GREEN), int(Light.YELLOW), int(Light.RED)


def approach_group(heading_rad: float) -> int:
    """Group of an approach: 0 where it runs rather east to west, 1 where it runs rather north to south."""
    return 0 if abs(math.cos(heading_rad)) >= abs(math.sin(heading_rad)) else 1


@kernel
def light_of(group: int, tick: int, offset_ticks: int) -> int:
    """`Light` of a group at a tick of a world that begins `offset_ticks` into the cycle."""
    phase = (tick + offset_ticks - group * _HALF_TICKS) % CYCLE_TICKS
    if phase < _GREEN_TICKS:
        return _GREEN
    return _YELLOW if phase < _GREEN_TICKS + _YELLOW_TICKS else _RED


def green_begins(group: int, tick: int) -> int:
    """Offset with which the green of a group begins at `tick`."""
    return (group * _HALF_TICKS - tick) % CYCLE_TICKS


@dataclass(frozen=True)
class Environment:
    """A named condition.

    Attributes:
        name: Recorded name.
        grip: Friction coefficient between tyre and road.
    """

    name: str
    grip: float


ENVIRONMENTS = MappingProxyType(
    {
        environment.name: environment
        for environment in (
            Environment("clear-noon", 0.90),
            Environment("cloudy-morning", 0.85),
            Environment("wet-sunset", 0.70),
            Environment("rain-night", 0.60),
        )
    }
)
"""Every condition by name."""
