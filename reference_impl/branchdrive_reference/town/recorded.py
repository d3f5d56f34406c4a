"""The map of a town as a dataset records it, as elements.

Broken elements are left out: a picture is no judgement of a dataset.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from branchdrive.contract.columns import table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.raw.rollout import MAP, ROLLOUTS
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.town_map import is_usable
from branchdrive_reference.town.elements import Element

__all__ = ["Rectangle", "recorded_elements"]

_OPTIONAL = ("lane_id", "width_m", "speed_limit_mps", "marking")


class Rectangle(NamedTuple):
    """An axis-parallel rectangle of the world, metres."""

    left_m: float
    low_m: float
    right_m: float
    high_m: float


def recorded_elements(
    rows: pa.Table, town: str, descriptor: Descriptor, *, near: Rectangle | None = None
) -> tuple[Element, ...]:
    """Usable elements of a town, those alone that meet `near` where it is given.

    Args:
        rows: Rows of the table `map`.
        town: The town.
        descriptor: The dataset's descriptor.
        near: A part of the world.
    """
    of_town = rows.filter(pc.equal(rows["town"], town))
    view = ShardView({ROLLOUTS: table_schema(ROLLOUTS).empty_table(), MAP: of_town}, descriptor)
    usable = np.flatnonzero(is_usable(view))
    if near is not None and len(usable):
        meets = np.ones(len(usable), bool)
        for column, low, high in (("x_m", near.left_m, near.right_m), ("y_m", near.low_m, near.high_m)):
            items, lengths = view.map.items(column)
            items = items[np.repeat(view.cached(is_usable), lengths)]
            lengths = lengths[usable]
            first = np.cumsum(lengths) - lengths
            meets &= np.minimum.reduceat(items, first) <= high
            meets &= np.maximum.reduceat(items, first) >= low
        usable = usable[meets]
    return tuple(_element(view, int(row)) for row in usable)


def _element(view: ShardView, row: int) -> Element:
    elements = view.map
    columns: dict[str, Any] = {name: elements[name][row] for name in ("element_id", "kind", "x_m", "y_m")}
    return columns | {name: elements[name][row] if elements.valid(name)[row] else None for name in _OPTIONAL}
