"""The maps below the groups of a report: of every town what lies around some group, once.

They are those of the dataset; without a map in the dataset, those of the towns of the reference package.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from branchdrive.contract.descriptor import Descriptor
from branchdrive_reference.report.packing import Packer, quantised
from branchdrive_reference.report.scene import Scene
from branchdrive_reference.report.shard_rows import ShardRows
from branchdrive_reference.town.elements import Element, town_elements
from branchdrive_reference.town.recorded import recorded_elements
from branchdrive_reference.town.town import TOWN_NAMES, town

__all__ = ["KINDS", "MARKINGS", "STEP_M", "Roads", "packed_roads"]

KINDS = (
    "lane", "shoulder", "parking", "road_area", "crossing", "lane_border", "kerb", "wall", "stop_line", "signal",
    "stop_sign", "yield_sign",
)  # fmt: skip
"""Kinds of elements as the player counts them."""

MARKINGS = ("none", "solid", "broken")
"""Markings of lines as the player counts them."""

STEP_M = 0.05
"""How finely places of maps are kept."""
_AROUND_M = 130.0
"""Farther from every future of a group than the player shows, nothing is kept."""

_MOST_VERTICES = 60_000
"""Of one town; elements beyond are left out and said to be."""


class Roads:
    """Maps of the towns of a dataset, collected shard by shard, and which of their elements groups lie among.

    Args:
        descriptor: Of the dataset.
    """

    def __init__(self, descriptor: Descriptor) -> None:
        self._descriptor = descriptor
        self._recorded: dict[str, pa.Table] = {}
        self._towns: dict[str, _Town] = {}

    def collect(self, shard: ShardRows) -> None:
        """Keep the maps of towns that no earlier shard had."""
        rows = shard.map
        if rows is None:
            return
        for name in pc.unique(rows.column("town").combine_chunks()).to_pylist():
            if name is not None and name not in self._recorded:
                self._recorded[name] = rows.filter(pc.equal(rows.column("town"), name))

    def around(self, name: str, scene: Scene) -> list[Element]:
        """Elements of a town near a scene; none where the town is unknown. Broken elements are left out."""
        if name not in self._towns:
            self._towns[name] = _Town(self._elements(name))
        return self._towns[name].around(scene)

    def packed(self) -> dict[str, dict[str, Any]]:
        """Of every town what lies around some scene that was asked for, as the player reads it."""
        return {name: packed_roads(town.used()) for name, town in sorted(self._towns.items()) if town.used()}

    def _elements(self, name: str) -> Sequence[Element]:
        if name in self._recorded:
            return recorded_elements(self._recorded[name], name, self._descriptor)
        return town_elements(town(name)) if name in TOWN_NAMES else ()


class _Town:
    """Elements of a town, and which are used."""

    def __init__(self, elements: Sequence[Element]) -> None:
        self._elements = [element for element in elements if element["x_m"].size and element["kind"] in KINDS]
        edges = [
            (each["x_m"].min(), each["y_m"].min(), each["x_m"].max(), each["y_m"].max()) for each in self._elements
        ]
        self._boxes = np.array(edges, np.float64).reshape(len(edges), 4)
        self._is_used = np.zeros(len(edges), bool)

    def around(self, scene: Scene) -> list[Element]:
        x = np.concatenate([future.x_m for future in scene.futures])
        y = np.concatenate([future.y_m for future in scene.futures])
        low = (self._boxes[:, 0] <= x.max() + _AROUND_M) & (self._boxes[:, 1] <= y.max() + _AROUND_M)
        high = (self._boxes[:, 2] >= x.min() - _AROUND_M) & (self._boxes[:, 3] >= y.min() - _AROUND_M)
        self._is_used |= low & high
        return [self._elements[place] for place in np.flatnonzero(low & high)]

    def used(self) -> list[Element]:
        return [self._elements[place] for place in np.flatnonzero(self._is_used)]


def packed_roads(elements: Sequence[Element]) -> dict[str, Any]:
    """Elements as the player reads them, at least one; coordinates count from the first vertex."""
    at = float(elements[0]["x_m"][0]), float(elements[0]["y_m"][0])
    packer, entries, num_vertices = Packer(), [], 0
    for element in elements:
        x, y = element["x_m"], element["y_m"]
        num_vertices += len(x)
        if num_vertices > _MOST_VERTICES:
            continue
        width = element.get("width_m")
        marking = element.get("marking")
        entries.append(
            [
                KINDS.index(element["kind"]),
                MARKINGS.index(marking) if marking in MARKINGS else 0,
                0 if width is None else round(100 * float(np.mean(width))),
                len(x),
            ]
        )
        packer.add(quantised(np.asarray(x) - at[0], STEP_M), order=2)
        packer.add(quantised(np.asarray(y) - at[1], STEP_M), order=2)
    return {
        "at": list(at),
        "elements": [value for entry in entries for value in entry],
        "is_cut": num_vertices > _MOST_VERTICES,
        "data": packer.text(),
    }
