"""The cameras that are rendered: six around the roof, one high above the ego, and the semantic bird's-eye view."""

from __future__ import annotations

import math
from collections.abc import Sequence

from branchdrive.contract.camera import Camera, PinholeCamera, TopDownCamera
from branchdrive.contract.semantic_bev import BEV_CAMERA, BEV_SIDE_PX, PX_PER_M

__all__ = ["MEDIA_STREAMS", "cameras_of"]

MEDIA_STREAMS = ("rgb_surround", "rgb_top_down", "semantic_bev")
"""Streams that can be rendered."""

_ROOF_M = 1.7
_AROUND = (
    ("front", 0.0, 70.0, 0.6, 0.0),
    ("front_left", 55.0, 70.0, 0.4, 0.5),
    ("front_right", -55.0, 70.0, 0.4, -0.5),
    ("rear", 180.0, 110.0, -0.6, 0.0),
    ("rear_left", 110.0, 70.0, -0.1, 0.5),
    ("rear_right", -110.0, 70.0, -0.1, -0.5),
)
"""Name, direction and horizontal field of view in degrees, and place of the cameras on the roof."""

_ABOVE_M, _ABOVE_DEG = 45.0, 70.0


def cameras_of(streams: Sequence[str], *, width_px: int = 160, height_px: int = 90) -> tuple[Camera, ...]:
    """Cameras of media streams; the size is that of the RGB images."""
    cameras: list[Camera] = []
    if "rgb_surround" in streams:
        cameras += [
            _pinhole(name, "rgb_surround", (width_px, height_px), fov, x=x, y=y, z=_ROOF_M, yaw=yaw)
            for name, yaw, fov, x, y in _AROUND
        ]
    if "rgb_top_down" in streams:
        size = (height_px, height_px)
        cameras.append(_pinhole("top_down", "rgb_top_down", size, _ABOVE_DEG, x=6.0, y=0.0, z=_ABOVE_M, pitch=-90.0))
    if "semantic_bev" in streams:
        middle = BEV_SIDE_PX / 2
        cameras.append(
            TopDownCamera(
                name=BEV_CAMERA,
                stream="semantic_bev",
                width_px=BEV_SIDE_PX,
                height_px=BEV_SIDE_PX,
                px_per_m=PX_PER_M,
                origin_row_px=middle,
                origin_column_px=middle,
            )
        )
    return tuple(cameras)


def _pinhole(
    name: str, stream: str, size_px: tuple[int, int], fov_deg: float, *, x: float, y: float, z: float,
    yaw: float = 0.0, pitch: float = 0.0,
) -> PinholeCamera:  # fmt: skip
    width_px, height_px = size_px
    focal_px = round(width_px / 2 / math.tan(math.radians(fov_deg) / 2), 6)
    return PinholeCamera(
        name=name,
        stream=stream,
        width_px=width_px,
        height_px=height_px,
        fx_px=focal_px,
        fy_px=focal_px,
        cx_px=width_px / 2,
        cy_px=height_px / 2,
        x_m=x,
        y_m=y,
        z_m=z,
        yaw_rad=round(math.radians(yaw), 6),
        pitch_rad=round(math.radians(pitch), 6),
    )
