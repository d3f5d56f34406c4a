"""Boxes and masses of what is on the road."""

from __future__ import annotations

from branchdrive_reference.world.body import Size

__all__ = [
    "BARRIER", "BICYCLE", "BIN", "BOX_TRUCK", "CAR", "CHILD", "COMPACT", "CONE", "CONTAINER", "PEDESTRIAN", "POST",
    "VAN", "VEHICLES",
]  # fmt: skip

CAR = Size(4.6, 1.9, 1.5, 1500.0)
COMPACT = Size(4.0, 1.75, 1.5, 1150.0)
VAN = Size(5.4, 2.0, 2.2, 2300.0)
BOX_TRUCK = Size(7.5, 2.3, 3.0, 6500.0)
BICYCLE = Size(1.8, 0.6, 1.7, 90.0)
PEDESTRIAN = Size(0.5, 0.6, 1.75, 75.0)
CHILD = Size(0.4, 0.5, 1.2, 30.0)
POST = Size(0.5, 0.5, 3.0, 8000.0)
BIN = Size(1.2, 1.0, 1.3, 200.0)
CONTAINER = Size(4.0, 1.8, 1.6, 6000.0)
BARRIER = Size(0.6, 2.2, 1.1, 120.0)
CONE = Size(0.4, 0.4, 0.8, 5.0)

VEHICLES = (CAR, COMPACT, VAN)
"""Ordinary traffic."""
