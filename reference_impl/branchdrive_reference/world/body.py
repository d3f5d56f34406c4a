"""Bodies: the ego and every actor as rows of one flat array, and the boxes and masses that they have.

Row 0 is the ego; the row of an actor is its recorded identity. Poses are box centres in the world frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum, IntFlag

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BARRIER",
    "BICYCLE",
    "BIN",
    "BODY",
    "BOX_TRUCK",
    "CAR",
    "CHILD",
    "COMPACT",
    "CONE",
    "CONTAINER",
    "EGO",
    "PEDESTRIAN",
    "POST",
    "VAN",
    "VEHICLES",
    "Behaviour",
    "Body",
    "Heed",
    "Kind",
    "Size",
    "body_table",
]

EGO = 0
"""Row of the ego."""


class Kind(IntEnum):
    """Recorded class; names in lower case are the values of ``actor_class``."""

    VEHICLE = 0
    CYCLE = 1
    PEDESTRIAN = 2
    STATIC = 3


class Behaviour(IntEnum):
    """What moves a body."""

    DRIVEN = 0  # the ego's commands
    STANDING = 1  # nothing; stays until it is hit
    FOLLOWING = 2  # the intelligent driver model, along a track
    WALKING = 3  # straight ahead until `travel_m` is used up
    FREE = 4  # contacts and friction only: it was hit


class Heed(IntFlag):
    """Which rules of the road a driver follows."""

    NOTHING = 0
    SIGNALS = 1
    PRIORITY = 2
    ALL = 3


BODY = np.dtype(
    [
        ("x_m", np.float64),
        ("y_m", np.float64),
        ("yaw_rad", np.float64),
        ("vel_x_mps", np.float64),
        ("vel_y_mps", np.float64),
        ("yaw_rate_radps", np.float64),
        ("length_m", np.float64),
        ("width_m", np.float64),
        ("height_m", np.float64),
        ("mass_kg", np.float64),
        ("speed_mps", np.float64),  # along the heading
        ("kind", np.int64),
        ("behaviour", np.int64),
        ("track", np.int64),
        ("arc_m", np.float64),  # on the track
        ("offset_m", np.float64),  # to the left of the track
        ("eagerness", np.float64),  # desired speed over advisory speed
        ("headway_s", np.float64),
        ("commanded_accel_mps2", np.float64),  # replaces the driver model; NaN where it is free
        ("travel_m", np.float64),
        ("goal_offset_m", np.float64),  # offset that it moves over to
        ("lateral_mps", np.float64),  # how fast it moves over
        ("heeds", np.int64),  # `Heed` flags
        ("siren", np.int64),  # whether others make way for it
        ("halt_m", np.float64),  # arc length where its front means to stop; infinite if it does not
    ],
    align=True,
)
"""One body."""


@dataclass(frozen=True)
class Size:
    """Box extents, metres, and mass, kilograms."""

    length_m: float
    width_m: float
    height_m: float
    mass_kg: float


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


@dataclass(frozen=True)
class Body:
    """A body before the first tick; the fields are those of `BODY`, and it keeps its offset unless another is given."""

    kind: Kind
    behaviour: Behaviour
    size: Size
    x_m: float
    y_m: float
    yaw_rad: float
    speed_mps: float = 0.0
    track: int = 0
    arc_m: float = 0.0
    offset_m: float = 0.0
    eagerness: float = 1.0
    headway_s: float = 1.2
    travel_m: float = 0.0
    goal_offset_m: float | None = None
    lateral_mps: float = 1.2
    heeds: Heed = Heed.ALL
    siren: bool = False


def body_table(bodies: Sequence[Body]) -> NDArray[np.void]:
    """`BODY` rows ``[bodies]`` of the given bodies, in order."""
    table = np.zeros(len(bodies), BODY)
    for row, body in zip(table, bodies, strict=True):
        for part in (body, body.size):
            for field in fields(part):
                if field.name not in ("size", "goal_offset_m"):
                    row[field.name] = getattr(part, field.name)
        row["goal_offset_m"] = body.offset_m if body.goal_offset_m is None else body.goal_offset_m
        row["vel_x_mps"] = body.speed_mps * math.cos(body.yaw_rad)
        row["vel_y_mps"] = body.speed_mps * math.sin(body.yaw_rad)
        row["commanded_accel_mps2"] = math.nan
        row["halt_m"] = math.inf
    return table
