"""What lies over what in the map of a picture."""

from __future__ import annotations

from enum import IntEnum

__all__ = ["Layer"]


class Layer(IntEnum):
    """Drawing order, the lowest first."""

    GROUND = 0
    PAVED = 1
    CARRIAGEWAY = 2
    MARKING = 3
    ROUTE = 4
    GHOST = 5
    ACTOR = 6
    HISTORY = 7
    RECOVERY = 8
    FUTURE = 9
    EGO = 10
    END = 11
    CONTACT = 12
    NOTE = 13
