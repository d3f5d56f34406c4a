"""Where a camera of the descriptor sees a point, and what a pixel of a map looks at.

Points are in the ego's frame on the ground: x forward and y left of the centre of its box, z up from the ground. Pixel
coordinates count from the upper left corner of an image: pixel 0 reaches from 0 to 1, with its centre at 0.5.

Source: spec/05-raw-streams.md#cameras.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.contract.camera import PinholeCamera, TopDownCamera

__all__ = ["camera_axes", "ground_of_pixels", "map_pixels", "pinhole_pixels"]

_Array = NDArray[np.float64]


def camera_axes(camera: PinholeCamera) -> _Array:
    """Axes ``[3, 3]`` of a camera in the ego's frame: a row each for right, down and the viewing axis.

    With yaw ``a``, pitch ``b`` and roll ``c``, the viewing axis is ``f = (cos b cos a, cos b sin a, sin b)``. Without
    roll, right is ``r0 = (sin a, -cos a, 0)`` and down ``d0 = f x r0``; with it, right is ``cos c r0 + sin c d0`` and
    down ``cos c d0 - sin c r0``.
    """
    sin_yaw, cos_yaw = np.sin(camera.yaw_rad), np.cos(camera.yaw_rad)
    sin_pitch, cos_pitch = np.sin(camera.pitch_rad), np.cos(camera.pitch_rad)
    sin_roll, cos_roll = np.sin(camera.roll_rad), np.cos(camera.roll_rad)
    forward = np.array([cos_pitch * cos_yaw, cos_pitch * sin_yaw, sin_pitch])
    right = np.array([sin_yaw, -cos_yaw, 0.0])
    down = np.array([sin_pitch * cos_yaw, sin_pitch * sin_yaw, -cos_pitch])
    return np.stack([cos_roll * right + sin_roll * down, cos_roll * down - sin_roll * right, forward])


def pinhole_pixels(camera: PinholeCamera, points_m: ArrayLike) -> tuple[_Array, _Array]:
    """Pixel coordinates ``[..., 2]`` of points ``[..., 3]``, columns first, and their depths ``[...]``.

    ``u = cx + fx X / Z``, ``v = cy + fy Y / Z``, with X to the right, Y down and the depth Z along the viewing axis.
    A point whose depth is not positive is not seen: its coordinates are NaN.
    """
    place_m = np.array([camera.x_m, camera.y_m, camera.z_m])
    seen_m = (np.asarray(points_m, np.float64) - place_m) @ camera_axes(camera).T
    depth_m = seen_m[..., 2]
    divisor_m = np.where(depth_m > 0, depth_m, np.nan)[..., np.newaxis]
    focal_px, centre_px = np.array([camera.fx_px, camera.fy_px]), np.array([camera.cx_px, camera.cy_px])
    return centre_px + focal_px * seen_m[..., :2] / divisor_m, depth_m


def map_pixels(camera: TopDownCamera, x_m: ArrayLike, y_m: ArrayLike) -> tuple[_Array, _Array]:
    """Rows and columns of points of the ground.

    ``row = origin_row - px_per_m x``, ``column = origin_column - px_per_m y``.
    """
    row_px = camera.origin_row_px - camera.px_per_m * np.asarray(x_m, np.float64)
    column_px = camera.origin_column_px - camera.px_per_m * np.asarray(y_m, np.float64)
    return row_px, column_px


def ground_of_pixels(camera: TopDownCamera, row_px: ArrayLike, column_px: ArrayLike) -> tuple[_Array, _Array]:
    """Points x, y of the ground at pixel coordinates: the inverse of `map_pixels`; add 0.5 for centres of pixels."""
    x_m = (camera.origin_row_px - np.asarray(row_px, np.float64)) / camera.px_per_m
    y_m = (camera.origin_column_px - np.asarray(column_px, np.float64)) / camera.px_per_m
    return x_m, y_m
