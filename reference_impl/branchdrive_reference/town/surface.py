"""What lies under a point: the lane and whether it is drivable."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from branchdrive_reference.geometry.polyline import Array
from branchdrive_reference.kernel import Records, kernel
from branchdrive_reference.town.network import RoadNetwork
from branchdrive_reference.town.road import JUNCTION_RADIUS_M

__all__ = ["Surface", "town_surface"]

_LANE = np.dtype(
    [
        ("first", np.int64),  # segment range in the segment table
        ("end", np.int64),
        ("half_width_m", np.float64),
        ("min_x_m", np.float64),
        ("max_x_m", np.float64),
        ("min_y_m", np.float64),
        ("max_y_m", np.float64),
    ],
    align=True,
)


@kernel
def _lanes_under(
    lanes: Records, vertex_x: Array, vertex_y: Array, x_m: Array, y_m: Array, found: NDArray[np.int64]
) -> None:
    """Lane with the nearest centre line among those that hold each point, -1 where none does."""
    for point in range(x_m.shape[0]):
        x, y = x_m[point], y_m[point]
        nearest = np.inf
        found[point] = -1
        for index in range(lanes.shape[0]):
            lane = lanes[index]
            if x < lane.min_x_m or x > lane.max_x_m or y < lane.min_y_m or y > lane.max_y_m:
                continue
            for segment in range(lane.first, lane.end):
                ex, ey = vertex_x[segment + 1] - vertex_x[segment], vertex_y[segment + 1] - vertex_y[segment]
                px, py = x - vertex_x[segment], y - vertex_y[segment]
                share = min(max((px * ex + py * ey) / (ex * ex + ey * ey), 0.0), 1.0)
                square = (px - share * ex) ** 2 + (py - share * ey) ** 2
                if square < nearest and square <= lane.half_width_m**2:
                    nearest = square
                    found[point] = index


@dataclass(frozen=True, eq=False)
class Surface:
    """Lookup tables of a town; `lane_id` names the rows of the lane table."""

    lane_id: tuple[str, ...]
    _lanes: NDArray[np.void]
    _vertex_x: Array
    _vertex_y: Array
    _junction_x: Array
    _junction_y: Array

    def lanes_under(self, x_m: Array, y_m: Array) -> list[str | None]:
        """Lane id under each point, ``None`` off the lanes."""
        found = np.empty(len(x_m), np.int64)
        _lanes_under(self._lanes, self._vertex_x, self._vertex_y, x_m, y_m, found)
        return [self.lane_id[index] if index >= 0 else None for index in found.tolist()]

    def in_junction(self, x_m: Array, y_m: Array) -> NDArray[np.bool_]:
        """Whether each point lies on the paved disc of a junction."""
        dx, dy = x_m[:, None] - self._junction_x, y_m[:, None] - self._junction_y
        return np.asarray((dx * dx + dy * dy <= JUNCTION_RADIUS_M**2).any(axis=1))


@lru_cache(maxsize=4)
def town_surface(town: RoadNetwork) -> Surface:
    """The tables of a town, built once per process."""
    rows = []
    first = 0
    for lane in town.lanes.values():
        x, y, half = lane.centre.x_m, lane.centre.y_m, lane.width_m / 2
        bounds = (x.min() - half, x.max() + half, y.min() - half, y.max() + half)
        rows.append((first, first + len(x) - 1, half, *bounds))
        first += len(x)
    centres = np.array(list(town.junctions.values()), np.float64)
    return Surface(
        tuple(town.lanes),
        np.array(rows, _LANE),
        np.concatenate([lane.centre.x_m for lane in town.lanes.values()]),
        np.concatenate([lane.centre.y_m for lane in town.lanes.values()]),
        centres[:, 0].copy(),
        centres[:, 1].copy(),
    )
