"""Every town by its recorded name."""

from __future__ import annotations

from types import MappingProxyType

from branchdrive_reference.town.interurban_town import INTERURBAN_TOWN_NAME, interurban_town
from branchdrive_reference.town.network import RoadNetwork
from branchdrive_reference.town.urban_town import URBAN_TOWN_NAME, urban_town

__all__ = ["TOWN_NAMES", "town"]

_BUILDERS = MappingProxyType({URBAN_TOWN_NAME: urban_town, INTERURBAN_TOWN_NAME: interurban_town})

TOWN_NAMES = tuple(_BUILDERS)
"""Names of the towns, in a fixed order."""


def town(name: str) -> RoadNetwork:
    """The network of a town, built once per process.

    Raises:
        KeyError: There is no town of this name.
    """
    return _BUILDERS[name]()
