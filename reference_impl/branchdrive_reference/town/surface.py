"""What lies under a point: the lane and whether it is drivable."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from branchdrive_reference.geometry.polyline import Array
from branchdrive_reference.kernel import Records, kernel
from branchdrive_reference.town.lane import LaneSide, Turn
from branchdrive_reference.town.network import RoadNetwork

__all__ = ["Surface", "town_surface"]

_LANE = np.dtype(
    [
        ("first", np.int64),  # segment range in the segment table
        ("end", np.int64),
        ("half_width_m", np.float64),
        ("right_m", np.float64),  # paved to the right of the centre line
        ("min_x_m", np.float64),
        ("max_x_m", np.float64),
        ("min_y_m", np.float64),
        ("max_y_m", np.float64),
    ],
    align=True,
)


@kernel
def _lanes_under(
    lanes: Records, vertex_x: Array, vertex_y: Array, x_m: Array, y_m: Array,
    found: NDArray[np.int64], paved: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Lane with the nearest centre line among those that hold each point, -1 for none, and whether it is paved.

    What is paved beside a lane ends with it, square to it.
    """
    for point in range(x_m.shape[0]):
        x, y = x_m[point], y_m[point]
        nearest = np.inf
        found[point] = -1
        for index in range(lanes.shape[0]):
            lane = lanes[index]
            if x < lane.min_x_m or x > lane.max_x_m or y < lane.min_y_m or y > lane.max_y_m:
                continue
            least, beside = np.inf, False
            for segment in range(lane.first, lane.end):
                ex, ey = vertex_x[segment + 1] - vertex_x[segment], vertex_y[segment + 1] - vertex_y[segment]
                px, py = x - vertex_x[segment], y - vertex_y[segment]
                share = min(max((px * ex + py * ey) / (ex * ex + ey * ey), 0.0), 1.0)
                square = (px - share * ex) ** 2 + (py - share * ey) ** 2
                if square <= least:
                    beyond = (segment == lane.first and share <= 0.0) or (segment == lane.end - 1 and share >= 1.0)
                    is_right = ex * py - ey * px <= 0.0 and not beyond
                    beside = is_right or (beside and square == least)
                    least = square
                if square < nearest and square <= lane.half_width_m**2:
                    nearest = square
                    found[point] = index
            if beside and least <= lane.right_m**2:
                paved[point] = True


@dataclass(frozen=True, eq=False)
class Surface:
    """Lookup tables of a town; `lane_id` names the rows of the lane table."""

    lane_id: tuple[str, ...]
    _lanes: NDArray[np.void]
    _vertex_x: Array
    _vertex_y: Array
    _junctions: Array

    def under(self, x_m: Array, y_m: Array) -> tuple[list[str | None], NDArray[np.bool_]]:
        """Lane id under each point, ``None`` off the lanes, and whether the point is drivable.

        Drivable are lanes, parking strips, shoulders and the paved discs of junctions.
        """
        found, paved = np.empty(len(x_m), np.int64), np.zeros(len(x_m), np.bool_)
        _lanes_under(self._lanes, self._vertex_x, self._vertex_y, x_m, y_m, found, paved)
        lanes = [self.lane_id[index] if index >= 0 else None for index in found.tolist()]
        return lanes, paved | (found >= 0) | self._in_junction(x_m, y_m)

    def _in_junction(self, x_m: Array, y_m: Array) -> NDArray[np.bool_]:
        x, y, radius = self._junctions
        dx, dy = x_m[:, None] - x, y_m[:, None] - y
        return np.asarray((dx * dx + dy * dy <= radius * radius).any(axis=1))


@lru_cache(maxsize=4)
def town_surface(town: RoadNetwork) -> Surface:
    """The tables of a town, built once per process."""
    rows = []
    first = 0
    for lane in town.lanes.values():
        x, y, half = lane.centre.x_m, lane.centre.y_m, lane.width_m / 2
        beside_m = lane.right_edge_m if lane.right in (LaneSide.PARKING, LaneSide.NOTHING) else half
        right_m = beside_m if lane.turn is Turn.FOLLOW else half
        bounds = (x.min() - right_m, x.max() + right_m, y.min() - right_m, y.max() + right_m)
        rows.append((first, first + len(x) - 1, half, right_m, *bounds))
        first += len(x)
    junctions = [(junction.x_m, junction.y_m, junction.radius_m) for junction in town.junctions.values()]
    return Surface(
        tuple(town.lanes),
        np.array(rows, _LANE),
        np.concatenate([lane.centre.x_m for lane in town.lanes.values()]),
        np.concatenate([lane.centre.y_m for lane in town.lanes.values()]),
        np.array(junctions, np.float64).reshape(-1, 3).T.copy(),
    )
