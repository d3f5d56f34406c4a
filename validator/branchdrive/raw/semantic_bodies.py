"""Vehicles of semantic maps against recorded boxes, image by image: the ego's, and those of the actors table.

A recorded vehicle shows by its channel and by its class, and every pixel of a vehicle lies on a recorded box, all
within a tolerance in pixels. Other vehicles are compared when and where all actors are recorded, the ego always.

Source: spec/05-raw-streams.md#images.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.semantic_bev import SemanticChannel, SemanticClass, classes_of
from branchdrive.driving.box import Boxes
from branchdrive.driving.risk import RANGE_M
from branchdrive.raw.semantic_frame import SemanticFrame, SemanticFrames
from branchdrive.raw.window import EVIDENCE_OFFSETS

__all__ = ["SemanticBodies"]

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Pixels = NDArray[np.uint8]

_SHOWN = ("vehicle", "cycle")

_EGO, _OTHER = int(SemanticChannel.EGO), int(SemanticChannel.OTHER_VEHICLE)
_BODY = int(SemanticClass.VEHICLE)
"""This bit is set in the classes of vehicles and of people, who may cover them, and in no other class that there is."""


class SemanticBodies:
    """Recorded boxes around the ego at the moment of every semantic map.

    Args:
        frames: The maps of a shard.

    Attributes:
        is_judged: Whether an image is a map with an observation ``[stored rows]``.
    """

    @np.errstate(all="ignore")  # recorded values may be anything; other rules judge them
    def __init__(self, frames: SemanticFrames) -> None:
        view, self._frames = frames.view, frames
        self.is_judged = frames.observation >= 0
        index = view.stream("frames")
        self._owner = index.rollout
        self._extents = tuple(view.rollouts[name].astype(np.float64) for name in ("ego_length_m", "ego_width_m"))
        self._has_actors = np.zeros(len(index), bool)
        if "actors" not in view:
            return
        offset = index.tick - np.append(view.branch_tick, 0)[index.rollout]
        in_window = (offset >= EVIDENCE_OFFSETS[0]) & (offset <= EVIDENCE_OFFSETS[-1])
        self._has_actors = np.append(view.branched, False)[index.rollout] & in_window
        actors = view.stream("actors")
        self._first, self._stop = actors.span(index.rollout, index.tick)
        codes, classes = actors.categories("actor_class")
        self._is_shown = np.array([name in _SHOWN for name in classes] + [False])[codes]
        self._boxes = Boxes(*(actors[name].astype(np.float64) for name in Boxes._fields))

    @np.errstate(all="ignore")
    def __call__(self, stored_row: int, pixels: Pixels) -> tuple[str, str] | None:
        """What is expected and found otherwise on the judged map of a stored row of the index, where anything is."""
        frame = self._frames[stored_row]
        rows, columns = np.divmod(np.flatnonzero((pixels & np.uint8(_EGO | _OTHER | _BODY)) != 0), pixels.shape[1])
        values = pixels[rows, columns]
        is_ego = (values & _EGO) != 0
        owner = self._owner[frame.row]
        own = Boxes(*np.zeros((3, 1)), *(values[[owner]] for values in self._extents))
        if _missing(own, pixels, frame, _EGO | _BODY) is not None:
            return "the ego at its place, by channel and class", "none there"
        if (at := _invented(own, rows[is_ego], columns[is_ego], frame)) is not None:
            return "the ego where it is recorded", f"it at row {at[0]}, column {at[1]} too"
        if not self._has_actors[frame.row]:
            return None
        here = slice(int(self._first[frame.row]), int(self._stop[frame.row]))
        boxes = frame.boxes_in_ego_frame(self._boxes.take(here))
        near = np.hypot(boxes.x_m, boxes.y_m) < RANGE_M
        at = _missing(boxes.take(np.flatnonzero(self._is_shown[here] & near)), pixels, frame, _OTHER | _BODY)
        if at is not None:
            return f"a vehicle at row {at[0]}, column {at[1]}, by channel and class, as recorded", "none there"
        is_other = ((values & _OTHER) != 0) | ((classes_of(values) == SemanticClass.VEHICLE) & ~is_ego)
        at = _invented(boxes, rows[is_other], columns[is_other], frame, RANGE_M)
        if at is not None:
            return "vehicles where actors are recorded", f"one at row {at[0]}, column {at[1]} too"
        return None


def _missing(boxes: Boxes, pixels: Pixels, frame: SemanticFrame, bits: int) -> tuple[int, int] | None:
    """Row and column of the centre of a box around which not all of some bits show."""
    slack = int(physical_bounds().bev_px)
    rows, columns = frame.pixels_at(boxes.x_m, boxes.y_m)
    inside = frame.is_well_inside(rows, columns)
    for row, column in zip(rows[inside].tolist(), columns[inside].tolist(), strict=True):
        around = pixels[row - slack : row + slack + 1, column - slack : column + slack + 1]
        if np.bitwise_or.reduce(around, axis=None) & bits != bits:
            return row, column
    return None


def _invented(
    boxes: Boxes, rows: Index, columns: Index, frame: SemanticFrame, range_m: float = np.inf
) -> tuple[int, int] | None:
    """Row and column of a pixel in range that no box explains."""
    camera = frame.camera
    x = (camera.origin_row_px - rows - 0.5) / camera.px_per_m
    y = (camera.origin_column_px - columns - 0.5) / camera.px_per_m
    slack_m = physical_bounds().bev_px / camera.px_per_m
    unexplained = np.hypot(x, y) < range_m - slack_m
    cos, sin = np.cos(boxes.yaw_rad), np.sin(boxes.yaw_rad)
    for box in range(len(boxes.x_m)):
        dx, dy = x - boxes.x_m[box], y - boxes.y_m[box]
        along, across = cos[box] * dx + sin[box] * dy, cos[box] * dy - sin[box] * dx
        reach_m, half_m = boxes.length_m[box] / 2 + slack_m, boxes.width_m[box] / 2 + slack_m
        unexplained &= (np.abs(along) > reach_m) | (np.abs(across) > half_m)
    found = np.flatnonzero(unexplained)
    return (int(rows[found[0]]), int(columns[found[0]])) if len(found) else None
