"""What of a map is drawn: the elements around the candidates of a scene.

They are those of the dataset; without a map in the dataset, those of the town, if the reference package has it.
"""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from branchdrive.raw.reader import Dataset
from branchdrive.raw.rollout import MAP
from branchdrive_reference.drawing.scene import DrawnScene
from branchdrive_reference.town.elements import Element, town_elements
from branchdrive_reference.town.recorded import Rectangle, recorded_elements
from branchdrive_reference.town.town import TOWN_NAMES, town

__all__ = ["elements_around"]

_AROUND_M = 150.0
"""Farther from every candidate than a picture is wide, nothing is drawn."""


def elements_around(dataset: Dataset, scene: DrawnScene) -> tuple[Element, ...]:
    """Elements near the candidates of a scene; none where the town is unknown. Broken elements are left out.

    Raises:
        DatasetError: The map cannot be read.
    """
    name = scene.record["town"]
    if MAP in dataset.descriptor.tables:
        rows = _map_of(dataset, name)
        return recorded_elements(rows, name, dataset.descriptor, near=_around(scene)) if rows is not None else ()
    return town_elements(town(name)) if name in TOWN_NAMES else ()


def _map_of(dataset: Dataset, name: str) -> pa.Table | None:
    """Rows of the map of a town, from the first shard that has it; ``None`` where no shard has."""
    for rows in dataset.table(MAP):
        of_town = rows.filter(pc.equal(rows["town"], name))
        if len(of_town):
            return of_town
    return None


def _around(scene: DrawnScene) -> Rectangle:
    """The part of the world that a picture of the scene can show."""
    x, y = (np.concatenate([getattr(one, name) for one in scene.candidates]) for name in ("x_m", "y_m"))
    low, high = (x.min() - _AROUND_M, y.min() - _AROUND_M), (x.max() + _AROUND_M, y.max() + _AROUND_M)
    return Rectangle(*map(float, (*low, *high)))
