"""Cameras of the descriptor: which stream they belong to, how large their images are, and what a pixel looks at.

Source: spec/05-raw-streams.md#cameras.
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from branchdrive.contract.document import Integer
from branchdrive.contract.refusal import Document

__all__ = ["Camera", "PinholeCamera", "TopDownCamera"]

_Name = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9._-]{0,127}$")]
_SizePx = Annotated[Integer, Field(ge=1, le=16384)]
_FocalPx = Annotated[float, Field(gt=0, le=1_000_000)]
_PointPx = Annotated[float, Field(ge=-100_000, le=100_000)]
_PlaceM = Annotated[float, Field(ge=-100, le=100)]
_AngleRad = Annotated[float, Field(ge=-3.1416, le=3.1416)]


class PinholeCamera(Document):
    """A perspective camera; its pose is given below the centre of the ego's box, on the ground.

    Attributes:
        name: Identity of the camera.
        stream: Claimed media stream that it belongs to.
        projection: ``pinhole``.
        width_px: Columns of an image.
        height_px: Rows of an image.
        fx_px: Focal length along the rows.
        fy_px: Focal length along the columns.
        cx_px: Principal point from the left edge.
        cy_px: Principal point from the upper edge.
        x_m: Forward of the centre of the ego's box.
        y_m: Left of it.
        z_m: Above the ground.
        yaw_rad: Positive to the left.
        pitch_rad: Positive upwards.
        roll_rad: Right-handed about the viewing axis.
    """

    name: _Name
    stream: Literal["rgb_surround", "rgb_top_down"]
    projection: Literal["pinhole"] = "pinhole"
    width_px: _SizePx
    height_px: _SizePx
    fx_px: _FocalPx
    fy_px: _FocalPx
    cx_px: _PointPx
    cy_px: _PointPx
    x_m: _PlaceM
    y_m: _PlaceM
    z_m: _PlaceM
    yaw_rad: _AngleRad
    pitch_rad: _AngleRad
    roll_rad: _AngleRad = 0.0


class TopDownCamera(Document):
    """A map of the ground around the ego, its heading up: every pixel is as large as every other.

    Attributes:
        name: Identity of the camera.
        stream: Claimed media stream that it belongs to.
        projection: ``top_down``.
        width_px: Columns of an image.
        height_px: Rows of an image.
        px_per_m: Scale.
        origin_row_px: Centre of the ego's box from the upper edge.
        origin_column_px: Centre of the ego's box from the left edge.
    """

    name: _Name
    stream: Literal["rgb_top_down", "semantic_bev"]
    projection: Literal["top_down"] = "top_down"
    width_px: _SizePx
    height_px: _SizePx
    px_per_m: Annotated[float, Field(gt=0, le=1000)]
    origin_row_px: _PointPx
    origin_column_px: _PointPx


Camera: TypeAlias = Annotated[PinholeCamera | TopDownCamera, Field(discriminator="projection")]
"""A camera of the descriptor."""
