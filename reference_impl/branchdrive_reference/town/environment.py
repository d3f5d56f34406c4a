"""Weather and light conditions, as far as the vehicle feels them."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

__all__ = ["ENVIRONMENTS", "Environment"]


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
