"""Crossroads: where roads meet, and who may go first."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

__all__ = ["Control", "Crossroads"]


class Control(Enum):
    """What orders the traffic of a junction."""

    SIGNAL = "signal"
    STOP = "stop"
    YIELD = "yield"


@dataclass(frozen=True)
class Crossroads:
    """Declared junction.

    Attributes:
        x_m: Centre, world frame.
        y_m: Centre, world frame.
        control: Signals, or the sign that the minor approaches have.
        major: Neighbouring junctions whose approaches have priority where there are no signals.
        radius_m: Roads end this far from the centre; the disc is paved.
    """

    x_m: float
    y_m: float
    control: Control
    major: frozenset[str] = field(default_factory=frozenset)
    radius_m: float = 16.0
