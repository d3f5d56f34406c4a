"""Points of a town that lie near other points of it, found in a grid of square cells.

Source: spec/05-raw-streams.md#map.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.surface import BLOCK_PAIRS, CELL_M, Work, cell_key, cell_of, places_in

__all__ = ["Points", "neighbours"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Points(NamedTuple):
    """Places in towns, each ``[points]``.

    Attributes:
        town: Number of the town, below 2 ** 15.
        x_m: World frame, within 1e7 m.
        y_m: The same, y.
    """

    town: Index
    x_m: Array
    y_m: Array


def neighbours(points: Points, others: Points, reach_m: float, work: Work) -> Iterator[tuple[Index, Index]]:
    """Pairs of points and others of their town that are at most `reach_m` apart, in blocks, each pair once.

    Args:
        points: Whose neighbours are asked for.
        others: Among which they are.
        reach_m: Largest distance.
        work: Pairs that may be compared.

    Raises:
        TooLargeError: There are more pairs in neighbouring cells.
    """
    cell_m = max(reach_m, CELL_M)
    column, row = (cell_of(values, cell_m) for values in points[1:])
    keys = cell_key(others.town, *(cell_of(values, cell_m) for values in others[1:]))
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    for away in product((-1, 0, 1), repeat=2):
        key = cell_key(points.town, column + away[0], row + away[1])
        first = np.searchsorted(keys, key)
        counts = np.searchsorted(keys, key, "right") - first
        work.spend(int(counts.sum()))
        some = np.flatnonzero(counts)
        for part in np.split(some, np.flatnonzero(np.diff(np.cumsum(counts[some]) // BLOCK_PAIRS)) + 1):
            owner, place = places_in(counts[part])
            point, other = part[owner], order[first[part[owner]] + place]
            near = np.hypot(points.x_m[point] - others.x_m[other], points.y_m[point] - others.y_m[other]) <= reach_m
            yield point[near], other[near]
