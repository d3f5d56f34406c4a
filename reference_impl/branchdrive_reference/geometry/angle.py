"""Angles in radians, counter-clockwise."""

from __future__ import annotations

import math

from branchdrive_reference.kernel import kernel

__all__ = ["wrap"]


@kernel
def wrap(angle_rad: float) -> float:
    """The same direction in ``[-pi, pi]``."""
    return math.atan2(math.sin(angle_rad), math.cos(angle_rad))
