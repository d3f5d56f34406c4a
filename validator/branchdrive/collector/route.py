"""Where the ego is on its route, as recorded: progress, offset, heading error and target points.

Everything follows from the recorded pose and the recorded polyline, so that it recomputes.

Source: spec/05-raw-streams.md#projection and #target-points.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.route import project

__all__ = ["route_columns", "to_ego_frame"]

Array = NDArray[np.float64]

_TARGET_SPACING_M = 20.0
_TARGET_MIN_AHEAD_M = 4.0
"""Target points are route points at multiples of the spacing, at least this far ahead."""


def to_ego_frame(dx_m: ArrayLike, dy_m: ArrayLike, yaw_rad: ArrayLike) -> tuple[Array, Array]:
    """World vectors ``[n]`` seen along headings ``[n]``: metres ahead, and to the left."""
    dx, dy, yaw = (np.asarray(values, np.float64) for values in (dx_m, dy_m, yaw_rad))
    cos, sin = np.cos(yaw), np.sin(yaw)
    return cos * dx + sin * dy, cos * dy - sin * dx


def route_columns(
    x_m: Array, y_m: Array, yaw_rad: NDArray[np.floating[Any]], route_x_m: Array, route_y_m: Array
) -> dict[str, Array]:
    """Route columns of the observations table, but the command.

    Target points lie at multiples of 20 m of the route, the first at least 4 m ahead of the ego.

    Args:
        x_m: Positions of the ego as recorded ``[observations]``.
        y_m: The same, y.
        yaw_rad: Headings as recorded, that is in float32 ``[observations]``.
        route_x_m: Route polyline ``[vertices]``, at least two, no two neighbours equal.
        route_y_m: The same, y.
    """
    yaw = yaw_rad.astype(np.float64)
    place = project(x_m, y_m, route_x_m, route_y_m)
    arc_m = np.concatenate([np.zeros(1), np.cumsum(np.hypot(np.diff(route_x_m), np.diff(route_y_m)))])
    columns = {
        "route_progress_m": place.progress_m,
        "route_offset_m": place.offset_m,
        "route_heading_error_rad": wrap_rad(yaw - place.heading_rad),
    }
    first_m = np.ceil((place.progress_m + _TARGET_MIN_AHEAD_M) / _TARGET_SPACING_M) * _TARGET_SPACING_M
    for number in (1, 2):
        target_m = first_m + (number - 1) * _TARGET_SPACING_M
        dx_m, dy_m = np.interp(target_m, arc_m, route_x_m) - x_m, np.interp(target_m, arc_m, route_y_m) - y_m
        columns[f"target_point_{number}_x_m"], columns[f"target_point_{number}_y_m"] = to_ego_frame(dx_m, dy_m, yaw)
    return columns
