"""A camera whose images are drawn at once."""

from __future__ import annotations

from branchdrive.contract.camera import TopDownCamera

SMALL = TopDownCamera(
    name="bev",
    stream="semantic_bev",
    width_px=32,
    height_px=32,
    px_per_m=0.5,
    origin_row_px=16.0,
    origin_column_px=16.0,
)
