"""Semantic maps of a shard: the camera of each, where the ego stands in the world, and which pixel sees what.

Source: spec/05-raw-streams.md#cameras, #images.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.camera import TopDownCamera
from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.semantic_bev import SEMANTIC_STREAM
from branchdrive.driving.box import Boxes
from branchdrive.raw.shard_view import ShardView

__all__ = ["TILE_M", "SemanticFrame", "SemanticFrames", "near_pixels"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

TILE_M = 64
"""What is recorded is looked up for all egos in a square of the world together."""

_LARGEST_M = 1e7
"""Positions end here."""


class SemanticFrame(NamedTuple):
    """One semantic map.

    Attributes:
        camera: Its camera.
        row: Its row of the index, as the view has it.
        x_m: Centre of the ego's box, world frame.
        y_m: The same, y.
        yaw_rad: Heading of the ego.
    """

    camera: TopDownCamera
    row: int
    x_m: float
    y_m: float
    yaw_rad: float

    def in_ego_frame(self, x_m: Array, y_m: Array) -> tuple[Array, Array]:
        """World points ahead and to the left of the ego, metres ``[points]``."""
        dx, dy, cos, sin = x_m - self.x_m, y_m - self.y_m, math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return cos * dx + sin * dy, cos * dy - sin * dx

    def boxes_in_ego_frame(self, boxes: Boxes) -> Boxes:
        """The same of boxes."""
        ahead, left = self.in_ego_frame(boxes.x_m, boxes.y_m)
        return Boxes(ahead, left, boxes.yaw_rad - self.yaw_rad, boxes.length_m, boxes.width_m)

    def pixels_at(self, ahead_m: Array, left_m: Array) -> tuple[Index, Index]:
        """Rows and columns of the pixels that hold points of the ego's frame, inside of the map or not ``[points]``."""
        camera = self.camera
        row, column = (
            np.floor(origin - camera.px_per_m * place)
            for origin, place in ((camera.origin_row_px, ahead_m), (camera.origin_column_px, left_m))
        )
        return row.astype(np.int64), column.astype(np.int64)

    def centres_of(self, rows: Index, columns: Index) -> tuple[Array, Array]:
        """Centres of pixels ahead and to the left of the ego, metres ``[pixels]``."""
        camera = self.camera
        ahead, left = (
            (origin - 0.5 - place.astype(np.float64)) / camera.px_per_m
            for origin, place in ((camera.origin_row_px, rows), (camera.origin_column_px, columns))
        )
        return ahead, left

    def is_well_inside(self, rows: Index, columns: Index) -> Mask:
        """Pixels whose neighbours within `bev_px` are all on the map ``[points]``."""
        slack, camera = int(physical_bounds().bev_px), self.camera
        inside = (rows >= slack) & (rows < camera.height_px - slack)
        return inside & (columns >= slack) & (columns < camera.width_px - slack)


class SemanticFrames:
    """Semantic maps by their stored rows of the index.

    Args:
        view: The shard, with its media index.

    Attributes:
        view: The shard.
        observation: Row of the observation of each map; -1 where there is none, its pose is no place, or the image is
            no semantic map ``[stored rows]``.
    """

    def __init__(self, view: ShardView) -> None:
        self.view = view
        frames, observations = view.stream("frames"), view.observations
        codes, names = frames.categories("camera")
        cameras = {
            camera.name: camera
            for camera in view.descriptor.cameras
            if isinstance(camera, TopDownCamera) and camera.stream == SEMANTIC_STREAM
        }
        self._cameras, self._codes = [cameras.get(name) for name in names] + [None], codes
        at = observations.find(frames.rollout, frames.tick)
        at = np.where(np.array([camera is not None for camera in self._cameras])[codes], at, -1)
        self._pose = [observations[name].astype(np.float64) for name in ("x_m", "y_m", "yaw_rad")]
        is_place = np.logical_and.reduce([np.abs(values) <= _LARGEST_M for values in self._pose])
        self.observation, self._rows = (np.empty(len(frames), np.int64) for _ in range(2))
        self.observation[frames.position] = np.where(np.append(is_place, False)[at], at, -1)
        self._rows[frames.position] = np.arange(len(frames))

    def __getitem__(self, stored_row: int) -> SemanticFrame:
        """The map of a stored row that has an observation."""
        row, at = int(self._rows[stored_row]), int(self.observation[stored_row])
        camera = self._cameras[self._codes[row]]
        if camera is None:
            raise KeyError(stored_row)
        return SemanticFrame(camera, row, *(float(values[at]) for values in self._pose))


def near_pixels(rows: Index, columns: Index, shape: tuple[int, ...], reach: int) -> Mask:
    """Pixels of an image that lie within a reach of one of some pixels, in rows and in columns ``[height, width]``."""
    height, width = shape
    edges = np.zeros((height + 1, width + 1), np.int32)
    top, bottom = (np.clip(rows + end, 0, height) for end in (-reach, reach + 1))
    left, right = (np.clip(columns + end, 0, width) for end in (-reach, reach + 1))
    for row, column, step in ((top, left, 1), (bottom, right, 1), (top, right, -1), (bottom, left, -1)):
        np.add.at(edges, (row, column), step)
    np.cumsum(edges, axis=0, out=edges)
    np.cumsum(edges, axis=1, out=edges)
    return np.asarray(edges[:-1, :-1] > 0)
