"""Clusters of routes with the same geometry.

Two routes of one town are close where their polylines, resampled by arc length to 32 points, lie less than 2 m apart,
by more than 1e-9 m, in the root mean square over points of equal index; a cluster is a connected
component of close routes. Routes that share only a part of their way, or run along it with a lag, are not close.

Source: paper, "Evaluation Population" (partitions share no route geometry); resampling and distance are this
project's choice.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["CLUSTER_POINTS", "CLUSTER_RMS_M", "resample_polyline", "route_clusters"]

Array = NDArray[np.float64]

CLUSTER_POINTS = 32
CLUSTER_RMS_M = 2.0

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
    town = np.unique(np.asarray(towns, np.str_), return_inverse=True)[1]
    limit = (CLUSTER_RMS_M - _ROUNDING_M) ** 2 * points.shape[1]
    flat = points.reshape(len(points), points.shape[1] * points.shape[2])
    labels = np.full(len(flat), -1)
    num_clusters = 0
    for seed in range(len(flat)):
        if labels[seed] >= 0:
            continue
        labels[seed] = num_clusters
        frontier = [seed]
        while frontier:
            here = frontier.pop()
            others = np.flatnonzero((labels < 0) & (town == town[here]))
            close = others[np.square(flat[others] - flat[here]).sum(axis=1) < limit]
            labels[close] = num_clusters
            frontier.extend(close.tolist())
        num_clusters += 1
    return labels
