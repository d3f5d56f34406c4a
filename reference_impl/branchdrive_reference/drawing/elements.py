"""What of a map is drawn: the elements around the candidates of a scene.

They are those of the dataset; without a map in the dataset, those of the town, if the reference package has it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from branchdrive.contract.columns import table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.raw.reader import Dataset
from branchdrive.raw.rollout import MAP, ROLLOUTS
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.town_map import is_usable
from branchdrive_reference.drawing.scene import Scene
from branchdrive_reference.town.elements import Element, town_elements
from branchdrive_reference.town.town import TOWN_NAMES, town

__all__ = ["elements_around"]

_AROUND_M = 150.0
"""Farther from every candidate than a picture is wide, nothing is drawn."""


def elements_around(dataset: Dataset, scene: Scene) -> tuple[Element, ...]:
    """Elements near the candidates of a scene; none where nobody knows the town. Broken elements are left out.

    Raises:
        DatasetError: The map cannot be read.
    """
    name = scene.record["town"]
    if MAP in dataset.descriptor.tables:
        rows = _map_of(dataset, name)
        return _near(rows, dataset.descriptor, scene) if rows is not None else ()
    return town_elements(town(name)) if name in TOWN_NAMES else ()


def _map_of(dataset: Dataset, name: str) -> pa.Table | None:
    """Rows of the map of a town, from the first shard that has it; ``None`` where no shard has."""
    for rows in dataset.table(MAP):
        of_town = rows.filter(pc.equal(rows["town"], name))
        if len(of_town):
            return of_town
    return None


def _near(rows: pa.Table, descriptor: Descriptor, scene: Scene) -> tuple[Element, ...]:
    view = ShardView({ROLLOUTS: table_schema(ROLLOUTS).empty_table(), MAP: rows}, descriptor)
    usable = np.flatnonzero(is_usable(view))
    near = np.ones(len(usable), bool)
    for column in ("x_m", "y_m"):
        driven = np.concatenate([getattr(candidate, column) for candidate in scene.candidates])
        items, lengths = view.map.items(column)
        items = items[np.repeat(view.cached(is_usable), lengths)]
        lengths = lengths[usable]
        first = np.cumsum(lengths) - lengths
        if len(usable):
            near &= np.minimum.reduceat(items, first) <= driven.max() + _AROUND_M
            near &= np.maximum.reduceat(items, first) >= driven.min() - _AROUND_M
    return tuple(_element(view, int(row)) for row in usable[near])


def _element(view: ShardView, row: int) -> Element:
    elements = view.map
    columns: dict[str, Any] = {name: elements[name][row] for name in ("element_id", "kind", "x_m", "y_m")}
    optional = ("lane_id", "width_m", "marking")
    return columns | {name: elements[name][row] if elements.valid(name)[row] else None for name in optional}
