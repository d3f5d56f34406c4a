"""Pinhole cameras, ready to project many points: the ground as a homography, and points by the camera's axes.

Source: spec/05-raw-streams.md#cameras.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.camera import PinholeCamera
from branchdrive.driving.projection import camera_axes

__all__ = ["Pinhole"]

Array = NDArray[np.float64]

_LEAST_SLOPE = 1e-6
"""A ray that falls by less per metre of depth sees no ground."""


@dataclass(frozen=True, eq=False)
class Pinhole:
    """A pinhole camera of a descriptor."""

    camera: PinholeCamera

    @cached_property
    def axes(self) -> Array:
        """Right, down and the viewing axis in the ego's frame, as rows ``[3, 3]``."""
        return camera_axes(self.camera)

    @cached_property
    def place_m(self) -> Array:
        """Place of the camera in the ego's frame ``[3]``."""
        return np.array([self.camera.x_m, self.camera.y_m, self.camera.z_m])

    @cached_property
    def intrinsics(self) -> Array:
        """Matrix from the axes of the camera to pixels, up to scale ``[3, 3]``."""
        camera = self.camera
        return np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1.0]])

    def seen(self, points_m: Array) -> Array:
        """Points of the ego's frame ``[.., 3]`` along the axes of the camera, same shape; the depth is the last."""
        return np.asarray((points_m - self.place_m) @ self.axes.T)

    def pixels(self, seen_m: Array) -> Array:
        """Pixels ``(u, v)`` ``[.., 2]`` of points along the axes of the camera ``[.., 3]`` of positive depth."""
        scale, middle = self._scale_and_middle
        return np.asarray(middle + scale * seen_m[..., :2] / seen_m[..., 2:])

    @cached_property
    def _scale_and_middle(self) -> tuple[Array, Array]:
        camera = self.camera
        return np.array([camera.fx_px, camera.fy_px]), np.array([camera.cx_px, camera.cy_px])

    @cached_property
    def ground(self) -> Array:
        """Homography of points ``(x, y, 1)`` of the ground to pixels ``(u, v, 1)``, up to scale ``[3, 3]``."""
        seen = np.column_stack([self.axes[:, 0], self.axes[:, 1], -self.axes @ self.place_m])
        return np.asarray(self.intrinsics @ seen)

    def frustum(self, near_m: float) -> tuple[Array, Array]:
        """Planes around what is seen beyond a depth: inward normals ``[5, 3]`` and their distances ``[5]``.

        A point ``p`` of the ego's frame is seen where ``normals @ p > distances``.
        """
        camera, (right, down, forward) = self.camera, self.axes
        normals = np.stack(
            [
                forward,
                right + camera.cx_px / camera.fx_px * forward,
                (camera.width_px - camera.cx_px) / camera.fx_px * forward - right,
                down + camera.cy_px / camera.fy_px * forward,
                (camera.height_px - camera.cy_px) / camera.fy_px * forward - down,
            ]
        )
        return normals, normals @ self.place_m + np.array([near_m, 0, 0, 0, 0])

    @cached_property
    def ground_m(self) -> Array:
        """Place of the ego's frame at which the centre of each pixel sees the ground ``[height, width, 2]``.

        ``nan`` above the horizon.
        """
        camera = self.camera
        u, v = np.meshgrid(np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5)
        depth_m = np.where(np.isfinite(self.depth_m), self.depth_m, np.nan)[..., None]
        rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(self.intrinsics).T
        return np.asarray(self.place_m[:2] + depth_m * (rays @ self.axes)[..., :2])

    @cached_property
    def depth_m(self) -> Array:
        """Depth at which the centre of each pixel sees the ground, ``inf`` above the horizon ``[height, width]``."""
        rise = self.axes[:, 2] @ np.linalg.inv(self.intrinsics)
        u, v = np.arange(self.camera.width_px) + 0.5, np.arange(self.camera.height_px)[:, None] + 0.5
        slope = rise[0] * u + rise[1] * v + rise[2]
        return np.where(slope < -_LEAST_SLOPE, self.camera.z_m / np.maximum(-slope, _LEAST_SLOPE), np.inf)
