"""Clusters of routes with the same geometry.

Two routes of one town are close where their polylines, resampled by arc length to 32 points, lie less than 2 m apart,
by more than 1e-9 m, in the root mean square over points of equal index; a cluster is a connected
component of close routes. Routes that share only a part of their way, or run along it with a lag, are not close.
Equal routes are one, and a route is compared with those whose centroid is near to its own, so that the work grows with
the number of distinct routes.

Source: paper, "Evaluation Population" (partitions share no route geometry); resampling and distance are this
project's choice.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["CLUSTER_POINTS", "CLUSTER_RMS_M", "resample_polyline", "route_clusters"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CLUSTER_POINTS = 32
CLUSTER_RMS_M = 2.0

_CELL_M = 4.0
"""Side of a cell of centroids: twice how far those of close routes lie apart, whatever they are rounded to."""

_ROUNDING_M = 1e-9
"""Parallel routes at the limit are not close, whatever the last bits of their distance."""


def resample_polyline(x_m: ArrayLike, y_m: ArrayLike, num_points: int = CLUSTER_POINTS) -> Array:
    """Points at equal distances along a polyline, ends included: ``[num_points, 2]``, in its frame.

    Args:
        x_m: Vertices ``[vertices]``, at least one; a polyline without length is one point.
        y_m: Vertices ``[vertices]``.
        num_points: Number of points.

    Raises:
        ValueError: There is no vertex, or the coordinates differ in number.
    """
    x, y = np.asarray(x_m, np.float64), np.asarray(y_m, np.float64)
    if x.shape != y.shape or x.ndim != 1 or not len(x):
        raise ValueError(f"a polyline has vertices [n] of two coordinates, found {list(x.shape)} and {list(y.shape)}")
    along = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))))
    at = np.linspace(0.0, along[-1], num_points)
    return np.stack([np.interp(at, along, x), np.interp(at, along, y)], axis=1)


def route_clusters(towns: Sequence[str], polylines: ArrayLike) -> NDArray[np.int64]:
    """Cluster of every route ``[routes]``, numbered from 0 in order of first appearance.

    Args:
        towns: Town of each route; routes of different towns are never close.
        polylines: Resampled routes ``[routes, points, 2]``, metres in the frame of their town; a route
            with a coordinate that is not a number is close to none.

    Raises:
        ValueError: Towns and polylines differ in number.
    """
    points = np.asarray(polylines, np.float64)
    if len(towns) != len(points) or points.ndim != 3:
        raise ValueError(f"{len(towns)} towns do not match polylines of shape {list(points.shape)}")
    town = np.unique(np.asarray(towns, np.str_), return_inverse=True)[1].astype(np.float64)
    flat = points.reshape(len(points), points.shape[1] * points.shape[2]) + 0.0  # -0.0 becomes 0.0
    distinct, of_route = _distinct(np.column_stack([town, flat]))
    labels = np.full(len(distinct), -1)
    cells = _Cells(flat[distinct], points[distinct].mean(axis=1), town[distinct])
    for seed in range(len(distinct)):
        if labels[seed] < 0:
            labels[cells.take_component(seed)] = seed
    return np.unique(labels, return_inverse=True)[1].astype(np.int64)[of_route]


def _distinct(rows: Array) -> tuple[Index, Index]:
    """First row of each kind, in order of appearance, and the kind of every row; one that is not finite is alone."""
    kinds: dict[bytes | int, int] = {}
    is_finite = np.all(np.isfinite(rows), axis=1)
    kind_of = [kinds.setdefault(row.tobytes() if is_finite[i] else i, len(kinds)) for i, row in enumerate(rows)]
    return np.unique(np.array(kind_of, np.int64), return_index=True)[1], np.array(kind_of, np.int64)


class _Cells:
    """Routes that belong to no component yet, by square cells of their centroids.

    ``|mean(a) - mean(b)| <= rms |a - b|``, so that close routes lie in cells that touch.

    Args:
        routes: ``[routes, coordinates]``, no two of one town alike.
        centroids: ``[routes, 2]``.
        towns: Number of the town of each route.
    """

    def __init__(self, routes: Array, centroids: Array, towns: Array) -> None:
        self._routes = routes
        self._limit = (CLUSTER_RMS_M - _ROUNDING_M) ** 2 * (routes.shape[1] // 2)
        self._cell_of = [tuple(cell) for cell in np.column_stack([towns, np.floor(centroids / _CELL_M)]).tolist()]
        self._left: dict[tuple[float, ...], list[int]] = {}
        for route, cell in enumerate(self._cell_of):
            self._left.setdefault(cell, []).append(route)

    def take_component(self, seed: int) -> list[int]:
        """Routes of the connected component of `seed`, which are taken away."""
        self._left[self._cell_of[seed]].remove(seed)
        taken = [seed]
        for route in taken:  # grows while it is gone through
            town, column, row = self._cell_of[route]
            for x in (column - 1, column, column + 1):
                for y in (row - 1, row, row + 1):
                    if others := self._left.get((town, x, y)):
                        taken += self._take_close(route, others)
        return taken

    def _take_close(self, route: int, others: list[int]) -> list[int]:
        with np.errstate(over="ignore", invalid="ignore"):
            close = np.square(self._routes[others] - self._routes[route]).sum(axis=1) < self._limit
        if not close.any():
            return []
        split: tuple[list[int], list[int]] = ([], [])
        for other, is_close in zip(others, close.tolist(), strict=True):
            split[is_close].append(other)
        others[:] = split[False]
        return split[True]
