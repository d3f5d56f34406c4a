"""The map of a recorded town, if the reference package has that town."""

from __future__ import annotations

from branchdrive_reference.town.network import RoadNetwork
from branchdrive_reference.town.registry import TOWN_NAMES, town

__all__ = ["town_map"]


def town_map(name: str) -> RoadNetwork | None:
    """The network of the town with this recorded name; ``None`` where the reference package has none."""
    return town(name) if name in TOWN_NAMES else None
