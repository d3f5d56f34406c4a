"""Vehicles and people of semantic maps against recorded boxes, image by image: the ego's, and those of the actors.

A recorded vehicle shows by its channel and by its class, a recorded person by the class, and every pixel of either lies
on a box of its kind, all within a tolerance in pixels. Actors are compared when and where all of them are recorded, the
ego always. Static objects have no class, so that none shows as a vehicle or person.

Source: spec/05-raw-streams.md#images.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.semantic_bev import SemanticChannel, SemanticClass, classes_of
from branchdrive.driving.box import Boxes
from branchdrive.driving.risk import RANGE_M
from branchdrive.raw.semantic.frame import SemanticFrame, SemanticFrames
from branchdrive.raw.window import EVIDENCE_OFFSETS

__all__ = ["SemanticActors", "SemanticPeople", "SemanticVehicles"]

Index = NDArray[np.int64]
Pixels = NDArray[np.uint8]
Text = tuple[str, str]

_EGO, _OTHER = int(SemanticChannel.EGO), int(SemanticChannel.OTHER_VEHICLE)
_BODY = int(SemanticClass.VEHICLE)
"""This bit is set in the classes of vehicles and of people, who may cover them, and in no other class that there is."""

_PERSON = np.uint8(SemanticClass.PEDESTRIAN)


class SemanticActors:
    """Recorded boxes of actors at the moment of every semantic map.

    Args:
        frames: The maps of a shard.

    Attributes:
        frames: The same.
        are_all: Whether all actors in range are recorded, by rows of the index as the view has it ``[rows]``.
    """

    def __init__(self, frames: SemanticFrames) -> None:
        view, self.frames = frames.view, frames
        index = view.stream("frames")
        self.are_all = np.zeros(len(index), bool)
        if "actors" not in view:
            return
        offset = index.tick - np.append(view.branch_tick, 0)[index.rollout]
        in_window = (offset >= EVIDENCE_OFFSETS[0]) & (offset <= EVIDENCE_OFFSETS[-1])
        self.are_all = np.append(view.branched, False)[index.rollout] & in_window
        actors = view.stream("actors")
        self._first, self._stop = actors.span(index.rollout, index.tick)
        self._codes, self._classes = actors.categories("actor_class")
        self._boxes = Boxes(*(actors[name].astype(np.float64) for name in Boxes._fields))

    def of(self, frame: SemanticFrame, kinds: tuple[str, ...]) -> Boxes:
        """Boxes of actors of some classes at the moment of a map, in the ego's frame."""
        first, stop = int(self._first[frame.row]), int(self._stop[frame.row])
        codes = self._codes[first:stop]
        is_kind = np.array([name in kinds for name in self._classes] + [False])[codes]
        return frame.boxes_in_ego_frame(self._boxes.take(first + np.flatnonzero(is_kind)))


class SemanticVehicles:
    """The ego and other vehicles of semantic maps against their boxes.

    Args:
        actors: The recorded actors of a shard.

    Attributes:
        is_judged: Whether an image is a map with an observation ``[stored rows]``.
    """

    def __init__(self, actors: SemanticActors) -> None:
        view, self._actors = actors.frames.view, actors
        self.is_judged = actors.frames.observation >= 0
        self._owner = view.stream("frames").rollout
        self._extents = tuple(view.rollouts[name].astype(np.float64) for name in ("ego_length_m", "ego_width_m"))

    @np.errstate(all="ignore")  # recorded values may be anything; other rules judge them
    def __call__(self, stored_row: int, pixels: Pixels) -> Text | None:
        """What is expected and found otherwise on the judged map of a stored row of the index, where anything is."""
        frame = self._actors.frames[stored_row]
        rows, columns = np.divmod(np.flatnonzero((pixels & np.uint8(_EGO | _OTHER | _BODY)) != 0), pixels.shape[1])
        values = pixels[rows, columns]
        is_ego = (values & _EGO) != 0
        owner = self._owner[frame.row]
        own = Boxes(*np.zeros((3, 1)), *(values[[owner]] for values in self._extents))
        if _missing(own, pixels, frame, _has(_EGO | _BODY)) is not None:
            return "the ego at its place, by channel and class", "none there"
        if (at := _invented(own, rows[is_ego], columns[is_ego], frame)) is not None:
            return "the ego where it is recorded", f"it at row {at[0]}, column {at[1]} too"
        if not self._actors.are_all[frame.row]:
            return None
        boxes = self._actors.of(frame, ("vehicle", "cycle"))
        if (at := _missing(_in_range(boxes), pixels, frame, _has(_OTHER | _BODY))) is not None:
            return f"a vehicle at row {at[0]}, column {at[1]}, by channel and class, as recorded", "none there"
        is_other = ((values & _OTHER) != 0) | ((classes_of(values) == SemanticClass.VEHICLE) & ~is_ego)
        if (at := _invented(boxes, rows[is_other], columns[is_other], frame, RANGE_M)) is not None:
            return "vehicles where vehicles and cycles are recorded", f"one at row {at[0]}, column {at[1]} too"
        return None


class SemanticPeople:
    """People of semantic maps against their boxes.

    Args:
        actors: The recorded actors of a shard.

    Attributes:
        is_judged: Whether an image is a map with an observation at which all actors are recorded ``[stored rows]``.
    """

    def __init__(self, actors: SemanticActors) -> None:
        self._actors = actors
        self.is_judged = actors.frames.observation >= 0
        self.is_judged[actors.frames.view.stream("frames").position[~actors.are_all]] = False

    @np.errstate(all="ignore")
    def __call__(self, stored_row: int, pixels: Pixels) -> Text | None:
        """What is expected and found otherwise on the judged map of a stored row of the index, where anything is."""
        frame = self._actors.frames[stored_row]
        boxes = self._actors.of(frame, ("pedestrian",))
        if (at := _missing(_in_range(boxes), pixels, frame, _has_person)) is not None:
            return f"a pedestrian at row {at[0]}, column {at[1]}, as recorded", "none there"
        rows, columns = np.divmod(np.flatnonzero(classes_of(pixels) == _PERSON), pixels.shape[1])
        if (at := _invented(boxes, rows, columns, frame, RANGE_M)) is not None:
            return "pedestrians where they are recorded", f"one at row {at[0]}, column {at[1]} too"
        return None


def _has(bits: int) -> Callable[[Pixels], bool]:
    """Whether a part of a map has all of some bits."""
    return lambda part: bool(np.bitwise_or.reduce(part, axis=None) & bits == bits)


def _has_person(part: Pixels) -> bool:
    return bool((classes_of(part) == _PERSON).any())


def _in_range(boxes: Boxes) -> Boxes:
    """Boxes whose centres are near enough to the ego's to be compared."""
    return boxes.take(np.flatnonzero(np.hypot(boxes.x_m, boxes.y_m) < RANGE_M))


def _missing(
    boxes: Boxes, pixels: Pixels, frame: SemanticFrame, shows: Callable[[Pixels], bool]
) -> tuple[int, int] | None:
    """Row and column of the centre of a box around which a map does not show what it should."""
    slack = int(physical_bounds().bev_px)
    rows, columns = frame.pixels_at(boxes.x_m, boxes.y_m)
    inside = frame.is_well_inside(rows, columns)
    for row, column in zip(rows[inside].tolist(), columns[inside].tolist(), strict=True):
        if not shows(pixels[row - slack : row + slack + 1, column - slack : column + slack + 1]):
            return row, column
    return None


def _invented(
    boxes: Boxes, rows: Index, columns: Index, frame: SemanticFrame, range_m: float = np.inf
) -> tuple[int, int] | None:
    """Row and column of a pixel in range that no box explains."""
    x, y = frame.centres_of(rows, columns)
    slack_m = physical_bounds().bev_px / frame.camera.px_per_m
    unexplained = np.hypot(x, y) < range_m - slack_m
    cos, sin = np.cos(boxes.yaw_rad), np.sin(boxes.yaw_rad)
    for box in range(len(boxes.x_m)):
        dx, dy = x - boxes.x_m[box], y - boxes.y_m[box]
        along, across = cos[box] * dx + sin[box] * dy, cos[box] * dy - sin[box] * dx
        reach_m, half_m = boxes.length_m[box] / 2 + slack_m, boxes.width_m[box] / 2 + slack_m
        unexplained &= (np.abs(along) > reach_m) | (np.abs(across) > half_m)
    found = np.flatnonzero(unexplained)
    return (int(rows[found[0]]), int(columns[found[0]])) if len(found) else None
