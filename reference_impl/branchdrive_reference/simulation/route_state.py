"""The ego relative to its route, as recorded: progress, offset, heading error, command and target points.

Everything is computed from the recorded pose and the recorded polyline, so that it recomputes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.angle import wrap_rad
from branchdrive_reference.geometry.polyline import Array
from branchdrive_reference.town.lane import Turn
from branchdrive_reference.town.route import Route
from branchdrive_reference.town.track import EGO_TRACK, RouteTracks

__all__ = ["route_columns"]

_COMMAND_AHEAD_M = 30.0
"""The command of a junction is given from this far before it."""

_TARGET_SPACING_M = 20.0
_TARGET_MIN_AHEAD_M = 4.0
"""Target points are route points at multiples of the spacing, at least this far ahead."""


def _commands(route: Route, progress_m: Array) -> NDArray[np.str_]:
    begin_m, end_m = route.junction_m
    at_junction = (progress_m >= begin_m - _COMMAND_AHEAD_M) & (progress_m < end_m)
    return np.where(at_junction, route.turn.value, Turn.FOLLOW.value)


def _in_ego_frame(dx_m: Array, dy_m: Array, yaw_rad: Array) -> tuple[Array, Array]:
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return cos * dx_m + sin * dy_m, cos * dy_m - sin * dx_m


def route_columns(tables: RouteTracks, x_m: Array, y_m: Array, yaw_rad: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
    """Route columns of the observations table for recorded poses ``[observations]``."""
    route, line, yaw = tables.route, tables.route.polyline, yaw_rad.astype(np.float64)
    place = line.position(x_m, y_m)
    path = tables.path(EGO_TRACK)
    segment = np.searchsorted(path["arc_m"], place.progress_m, side="right") - 1
    columns: dict[str, NDArray[Any]] = {
        "speed_limit_mps": tables.limit_mps[segment],
        "route_progress_m": place.progress_m,
        "route_offset_m": place.offset_m,
        "route_heading_error_rad": wrap_rad(yaw - place.heading_rad),
        "command": _commands(route, place.progress_m),
    }
    first_m = np.ceil((place.progress_m + _TARGET_MIN_AHEAD_M) / _TARGET_SPACING_M) * _TARGET_SPACING_M
    for number in (1, 2):
        tx, ty = line.at(first_m + (number - 1) * _TARGET_SPACING_M)
        px, py = _in_ego_frame(tx - x_m, ty - y_m, yaw)
        columns[f"target_point_{number}_x_m"], columns[f"target_point_{number}_y_m"] = px, py
    return columns
