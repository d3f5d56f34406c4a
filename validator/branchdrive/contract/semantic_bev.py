"""Values of the semantic bird's-eye view: a class in the low four bits of a pixel, channels in the others.

Source: spec/05-raw-streams.md#semantic-bev.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum, IntFlag
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BEV_CAMERA", "BEV_SIDE_PX", "CHANNEL_MEANING", "CLASS_MEANING", "PX_PER_M", "ROUTE_WIDTH_M", "SEMANTIC_STREAM",
    "SemanticChannel", "SemanticClass", "channels_of", "classes_of",
]  # fmt: skip

SEMANTIC_STREAM = "semantic_bev"
"""Name of the stream."""

BEV_CAMERA = "bev"
"""Name of the stream's camera."""

BEV_SIDE_PX = 256
"""Rows and columns of a view."""

PX_PER_M = 2.0
"""Scale of a view; its middle is the centre of the ego's box."""

ROUTE_WIDTH_M = 2.0
"""Width of the band that shows the remaining route."""

_CLASS_BITS = 0b1111


class SemanticClass(IntEnum):
    """What covers the centre of a pixel, seen from above; a higher class covers a lower one."""

    NOTHING = 0
    ROAD = 1
    SIDEWALK = 2
    LANE_MARKING = 3
    STOP_SIGN = 4
    RED_LIGHT = 5
    YELLOW_LIGHT = 6
    GREEN_LIGHT = 7
    VEHICLE = 8
    PEDESTRIAN = 9


class SemanticChannel(IntFlag):
    """Binary channels of a pixel."""

    EGO = 16
    OTHER_VEHICLE = 32
    DRIVABLE_AREA = 64
    REMAINING_ROUTE = 128


CLASS_MEANING: Mapping[SemanticClass, str] = MappingProxyType(
    {
        SemanticClass.NOTHING: "none of the others, or not known",
        SemanticClass.ROAD: "ground that motor vehicles drive or stop on",
        SemanticClass.SIDEWALK: "ground beside the road that is made for people on foot",
        SemanticClass.LANE_MARKING: "paint of lane borders, stop lines and crossings",
        SemanticClass.STOP_SIGN: "a stop sign, or the place where it has vehicles stop",
        SemanticClass.RED_LIGHT: "a traffic light that shows red, or the place where vehicles wait at it",
        SemanticClass.YELLOW_LIGHT: "the same of one that shows yellow",
        SemanticClass.GREEN_LIGHT: "the same of one that shows green",
        SemanticClass.VEHICLE: "the box of a motor vehicle or cycle, the ego's own too",
        SemanticClass.PEDESTRIAN: "the box of a person on foot",
    }
)
"""Meaning of every class."""

CHANNEL_MEANING: Mapping[SemanticChannel, str] = MappingProxyType(
    {
        SemanticChannel.EGO: "the ego's box",
        SemanticChannel.OTHER_VEHICLE: "the box of another motor vehicle or cycle",
        SemanticChannel.DRIVABLE_AREA: "lanes, shoulders, parking strips and road areas",
        SemanticChannel.REMAINING_ROUTE: (
            f"a band of {ROUTE_WIDTH_M:g} m, with the route from the ego on to its end in the middle"
        ),
    }
)
"""Meaning of every channel."""


def classes_of(values: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Class of every pixel, as numbers of `SemanticClass`; uint8 of any shape."""
    return values & np.uint8(_CLASS_BITS)


def channels_of(values: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Binary channels ``[..., 4]`` of views ``[...]``, in the order of `SemanticChannel`."""
    bits = np.array([channel.value for channel in SemanticChannel], np.uint8)
    return (values[..., np.newaxis] & bits).astype(np.bool_)
