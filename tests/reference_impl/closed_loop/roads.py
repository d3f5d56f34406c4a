"""A tiny world to drive in: forty straight roads with a parked car each, those of the collector template."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from tests.repo.checkout import ROOT

from branchdrive.collector.group import WorldCollector
from branchdrive.contract.descriptor import Software
from branchdrive_reference.benchmark.release import Release
from branchdrive_reference.closed_loop.site import Route
from branchdrive_reference.closed_loop.world_field import WorldField

__all__ = ["KNOWN_ROADS", "ROADS", "Roads"]

KNOWN_ROADS = (0, 1, 2)
"""Roads that training groups are said to drive on."""


def _straight_road() -> Any:
    names: dict[str, Any] = {"__name__": "minimal_collector"}
    path = ROOT / "docs" / "examples" / "minimal_collector.py"
    exec(compile(path.read_text(encoding="utf-8"), path, "exec", dont_inherit=True), names)
    return names["StraightRoad"]()


ROADS = WorldCollector({"ParkedObstacle": partial(_straight_road)})


class Roads(WorldField):
    """These roads, as a field that knows its training routes without a raw layer."""

    @classmethod
    def make(cls) -> Roads:
        """The field."""
        return cls(f"{__name__}:ROADS", Software(name="straight-road", version="1.0"), True)

    def routes_of(self, release: Release, groups: Sequence[str]) -> list[Route]:
        """Routes of the roads `KNOWN_ROADS`, half a metre beside them."""
        found = []
        for index in range(200):
            place, route = self.place(1, index)
            if place.route_id in {f"road-{road}" for road in KNOWN_ROADS}:
                found.append(Route(route.town, route.points + np.array([0.0, 0.5])))
        return found
