"""Wrong units and signs of recorded motion, by the ratio of what is recorded to what the poses say.

Source: spec/02-time-frames-units.md#units.
"""

from __future__ import annotations

import math
from typing import NamedTuple

__all__ = ["WrongUnit", "is_near", "wrong_unit"]

_GRAVITY_MPS2 = 9.81


class WrongUnit(NamedTuple):
    """What a quantity is recorded in.

    Attributes:
        ratio: How many times too large it makes the quantity; negative where it has the contrary sign.
        text: What the quantity is in.
        remedy: What makes it right.
    """

    ratio: float
    text: str
    remedy: str


_SPEED = (
    WrongUnit(3.6, "in km/h", "divide by 3.6"),
    WrongUnit(2.236936, "in miles per hour", "divide by 2.237"),
    WrongUnit(3.28084, "in feet per second", "divide by 3.281"),
    WrongUnit(100.0, "in centimetres per second, or positions in units of 100 m", "divide by 100"),
    WrongUnit(0.01, "in m/s, and positions in centimetres", "divide positions by 100, and extents"),
    WrongUnit(0.3048, "in m/s, and positions in feet", "multiply positions by 0.3048, and extents"),
)
_YAW_RATE = (WrongUnit(math.degrees(1), "in degrees per second", "multiply by pi / 180"),)
_ACCELERATION = (WrongUnit(1 / _GRAVITY_MPS2, "in g", f"multiply by {_GRAVITY_MPS2:g}"),)
_CONTRARY = WrongUnit(-1.0, "of the contrary sign", "negate it")

_UNITS = {
    **dict.fromkeys(("speed", "actor_speed", "pedestrian_speed"), (0.05, _SPEED)),
    "yaw_rate": (0.4, _YAW_RATE),
    **dict.fromkeys(("longitudinal", "lateral"), (0.1, _ACCELERATION)),
}
"""Units of each quantity, and how far logarithms of ratios that are one may differ: turns change inside of a step."""

_OF_COMMANDS = ("steering", "drive")
"""Quantities of which the sign alone is known."""


def is_near(ratio: float, value: float, tolerance: float) -> bool:
    """Whether two ratios of one sign have logarithms that differ by less than a tolerance."""
    return ratio * value > 0 and abs(math.log(ratio / value)) < tolerance


def wrong_unit(quantity: str, ratio: float) -> WrongUnit | None:
    """What a quantity of [calibration](spec/07-rules.md#calibration) is recorded in; ``None`` where no unit fits.

    Args:
        quantity: Its name.
        ratio: Recorded values by those of the poses.
    """
    tolerance, units = _UNITS.get(quantity, (0.0, ()))
    if (units or quantity in _OF_COMMANDS) and ratio < 0:
        return _CONTRARY
    return next((unit for unit in units if is_near(ratio, unit.ratio, tolerance)), None)
