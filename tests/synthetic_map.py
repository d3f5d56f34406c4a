"""The small valid dataset with maps of its towns."""

from __future__ import annotations

from functools import cache
from typing import Any

from tests.scenes import SCENES
from tests.synthetic import SHARDS, Tables, base_tables, descriptor, shared

from branchdrive.testing.town import with_map

__all__ = ["map_descriptor", "map_tables"]


@cache
def map_tables() -> dict[str, Tables]:
    """`base_tables` with maps: a lane along every route on open ground, and further elements that nobody is on."""
    scenes = dict(enumerate(SCENES))
    return shared(
        {
            folder: with_map(base_tables()[folder], [SCENES[index].town for index in groups], scenes)
            for folder, groups in SHARDS.items()
        }
    )


def map_descriptor() -> dict[str, Any]:
    """Descriptor document of `map_tables`."""
    document = descriptor()
    return {**document, "streams": [*document["streams"], "map"]}
