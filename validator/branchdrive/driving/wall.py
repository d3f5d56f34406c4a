"""Walls that reach into oriented boxes: segments in the plane, clipped at the sides of a box.

Source: spec/05-raw-streams.md#map.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.box import Boxes
from branchdrive.driving.surface import Strips, Work

__all__ = ["Inside", "Walls"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Inside(NamedTuple):
    """Parts of walls inside of boxes, each field ``[parts]``: the box, the wall, and the middle of the part."""

    box: Index
    wall: Index
    x_m: Array
    y_m: Array


class Walls:
    """Segments of walls, found by place.

    Args:
        town: Town of each wall ``[walls]``, below 2 ** 15.
        lengths: Vertices of each wall, at least two ``[walls]``.
        x_m: Vertices of all walls, one wall after the other ``[vertices]``, within 1e7 m.
        y_m: The same, y.
        reach_m: How far a box reaches from its centre at most.
        most_squares: Cells that pieces of segments may be filed in, together.

    Raises:
        TooLargeError: The walls cover too much ground.
    """

    def __init__(
        self, town: Index, lengths: Index, x_m: Array, y_m: Array, *, reach_m: float, most_squares: int
    ) -> None:
        wall = np.repeat(np.arange(len(lengths)), lengths)
        first = np.flatnonzero(wall[1:] == wall[:-1])
        self._wall = wall[first]
        self._x, self._y = (np.stack([values[first], values[first + 1]]) for values in (x_m, y_m))
        ends = np.full(2 * len(first), 2 * reach_m)
        self._filed = Strips(
            town[self._wall], np.full(len(first), 2), self._x.T.ravel(), self._y.T.ravel(), ends, slack_m=0.0,
            most_squares=most_squares,
        )  # fmt: skip

    def inside(self, town: Index, boxes: Boxes, work: Work) -> Iterator[Inside]:
        """Parts of walls inside of boxes, in blocks; a part may occur several times.

        Raises:
            TooLargeError: There are more pairs of boxes and segments than may be compared.
        """
        for box, segment, excess_m, _ in self._filed.near(town, boxes.x_m, boxes.y_m, work):
            near = np.flatnonzero(excess_m <= 0)
            box, segment = box[near], segment[near]
            cos, sin = np.cos(boxes.yaw_rad[box]), np.sin(boxes.yaw_rad[box])
            away = [self._x[:, segment] - boxes.x_m[box], self._y[:, segment] - boxes.y_m[box]]
            ahead, left = cos * away[0] + sin * away[1], cos * away[1] - sin * away[0]
            enters, leaves = np.zeros(len(box)), np.ones(len(box))
            for (start, stop), half_m in ((ahead, boxes.length_m[box] / 2), (left, boxes.width_m[box] / 2)):
                with np.errstate(divide="ignore", invalid="ignore"):
                    shares = np.sort([(-half_m - start) / (stop - start), (half_m - start) / (stop - start)], axis=0)
                is_along = start == stop
                shares[:, is_along] = np.where(
                    np.abs(start[is_along]) < half_m[is_along], [[0.0], [1.0]], [[1.0], [0.0]]
                )
                enters, leaves = np.maximum(enters, shares[0]), np.minimum(leaves, shares[1])
            is_inside = np.flatnonzero(enters < leaves)
            box, segment, middle = box[is_inside], segment[is_inside], ((enters + leaves) / 2)[is_inside]
            x, y = (ends[0, segment] + middle * (ends[1] - ends[0])[segment] for ends in (self._x, self._y))
            yield Inside(box, self._wall[segment], x, y)
