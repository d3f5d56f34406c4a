"""Vehicles of semantic maps against the boxes of the actors table, image by image.

Every recorded vehicle or cycle whose centre lies on the map shows there, and every pixel of another vehicle lies on
the box of a recorded actor: both within a tolerance in pixels, and when and where all actors
are recorded. The channels of the ego, of the drivable area and of the route are compared with nothing.

Source: spec/05-raw-streams.md#images.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.camera import TopDownCamera
from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.semantic_bev import SemanticChannel, SemanticClass, classes_of
from branchdrive.driving.box import Boxes
from branchdrive.driving.risk import RANGE_M
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import EVIDENCE_OFFSETS

__all__ = ["SemanticActors"]

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

_SHOWN = ("vehicle", "cycle")


class SemanticActors:
    """Recorded boxes around the ego at the moment of every image of a semantic map.

    Args:
        view: The shard, with its media index.
        cameras: Cameras of semantic maps by name.

    Attributes:
        is_judged: Whether an image is one of a map at a moment whose actors are recorded ``[stored rows]``.
    """

    @np.errstate(all="ignore")  # recorded values may be anything; other rules judge them
    def __init__(self, view: ShardView, cameras: Mapping[str, TopDownCamera]) -> None:
        self._view = view
        frames, observations = view.stream("frames"), view.observations
        stored = np.empty(len(frames), np.int64)
        stored[frames.position] = np.arange(len(frames))
        self._row, self._cameras, self._names = stored, cameras, frames["camera"]
        offset = frames.tick - np.append(view.branch_tick, 0)[frames.rollout]
        is_recorded = np.append(view.branched, False)[frames.rollout]
        is_recorded &= (offset >= EVIDENCE_OFFSETS[0]) & (offset <= EVIDENCE_OFFSETS[-1])
        self._at = np.where(is_recorded, observations.find(frames.rollout, frames.tick), -1)
        self.is_judged = np.zeros(len(frames), bool)
        self.is_judged[frames.position] = (self._at >= 0) & [name in cameras for name in self._names]
        actors = view.stream("actors")
        self._first, self._stop = actors.span(frames.rollout, frames.tick)
        codes, classes = actors.categories("actor_class")
        self._is_shown = np.array([name in _SHOWN for name in classes] + [False])[codes]
        self._pose = tuple(observations[name].astype(np.float64) for name in ("x_m", "y_m", "yaw_rad"))
        self._boxes = Boxes(*(actors[name].astype(np.float64) for name in Boxes._fields))

    @np.errstate(all="ignore")
    def __call__(self, stored_row: int, pixels: Pixels) -> tuple[str, str] | None:
        """What is expected and found otherwise on the judged map of a stored row of the index, where anything is."""
        row = int(self._row[stored_row])
        camera, at = self._cameras[self._names[row]], int(self._at[row])
        here = slice(int(self._first[row]), int(self._stop[row]))
        boxes = _in_ego_frame(self._boxes.take(here), *(float(values[at]) for values in self._pose))
        shown = (pixels & np.uint8(SemanticChannel.OTHER_VEHICLE)) != 0
        shown |= (classes_of(pixels) == SemanticClass.VEHICLE) & ((pixels & np.uint8(SemanticChannel.EGO)) == 0)
        missing = _missing(boxes.take(np.flatnonzero(self._is_shown[here])), shown, camera)
        if missing is not None:
            return f"a vehicle at row {missing[0]}, column {missing[1]}, as recorded", "none there"
        invented = _invented(boxes, shown, camera)
        if invented is not None:
            return "vehicles where actors are recorded", f"one at row {invented[0]}, column {invented[1]} too"
        return None


def _in_ego_frame(boxes: Boxes, x_m: float, y_m: float, yaw_rad: float) -> Boxes:
    dx, dy, cos, sin = boxes.x_m - x_m, boxes.y_m - y_m, np.cos(yaw_rad), np.sin(yaw_rad)
    return Boxes(cos * dx + sin * dy, cos * dy - sin * dx, boxes.yaw_rad - yaw_rad, boxes.length_m, boxes.width_m)


def _missing(boxes: Boxes, shown: NDArray[np.bool_], camera: TopDownCamera) -> tuple[int, int] | None:
    """Row and column of the centre of a box that does not show."""
    slack = int(physical_bounds().bev_px)
    is_recorded = np.hypot(boxes.x_m, boxes.y_m) < RANGE_M
    rows = np.floor(camera.origin_row_px - camera.px_per_m * boxes.x_m[is_recorded]).astype(np.int64)
    columns = np.floor(camera.origin_column_px - camera.px_per_m * boxes.y_m[is_recorded]).astype(np.int64)
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        is_inside = slack <= row < camera.height_px - slack and slack <= column < camera.width_px - slack
        if is_inside and not shown[row - slack : row + slack + 1, column - slack : column + slack + 1].any():
            return row, column
    return None


def _invented(boxes: Boxes, shown: NDArray[np.bool_], camera: TopDownCamera) -> tuple[int, int] | None:
    """Row and column of a pixel that no box explains."""
    rows, columns = np.nonzero(shown)
    x = (camera.origin_row_px - rows - 0.5) / camera.px_per_m
    y = (camera.origin_column_px - columns - 0.5) / camera.px_per_m
    slack_m = physical_bounds().bev_px / camera.px_per_m
    unexplained = np.hypot(x, y) < RANGE_M - slack_m
    cos, sin = np.cos(boxes.yaw_rad), np.sin(boxes.yaw_rad)
    for box in range(len(boxes.x_m)):
        dx, dy = x - boxes.x_m[box], y - boxes.y_m[box]
        along, across = cos[box] * dx + sin[box] * dy, cos[box] * dy - sin[box] * dx
        reach_m, half_m = boxes.length_m[box] / 2 + slack_m, boxes.width_m[box] / 2 + slack_m
        unexplained &= (np.abs(along) > reach_m) | (np.abs(across) > half_m)
    found = np.flatnonzero(unexplained)
    return (int(rows[found[0]]), int(columns[found[0]])) if len(found) else None
