"""A group as a small drawing, an SVG path for each candidate, in the frame in which the ego drives to the right."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from branchdrive_reference.report.scene import Future, Scene
from branchdrive_reference.town.elements import Element

__all__ = ["HEIGHT", "WIDTH", "Stroke", "Thumbnail", "thumbnail"]

WIDTH, HEIGHT = 240, 132
"""Of a drawing, in its own units."""

_LEAST_WIDTH_M = 45.0
_MARGIN = 10

Points = NDArray[np.float64]


@dataclass(frozen=True)
class Stroke:
    """One line of a drawing.

    Attributes:
        family: Of the candidate.
        path: Data of an SVG path.
        contact: Where it first touches something, if it does.
    """

    family: str
    path: str
    contact: tuple[int, int] | None


@dataclass(frozen=True)
class Thumbnail:
    """A drawing: lanes by width, then candidates, the nominal last, and the ego at the branch."""

    lanes: Sequence[tuple[int, str]]
    strokes: Sequence[Stroke]
    ego: str


def thumbnail(scene: Scene, elements: Sequence[Element]) -> Thumbnail:
    """The drawing of a scene with at least one future."""
    x, y, heading = scene.origin
    cos, sin = math.cos(heading), math.sin(heading)

    def placed(x_m: Points, y_m: Points) -> Points:
        return np.stack([cos * (x_m - x) + sin * (y_m - y), cos * (y_m - y) - sin * (x_m - x)], axis=1)

    futures = [placed(one.x_m, one.y_m)[one.tick >= -20] for one in scene.futures]
    points = np.concatenate([*futures, np.zeros((1, 2))])
    low, high = points.min(axis=0), points.max(axis=0)
    room = WIDTH - 2 * _MARGIN, HEIGHT - 2 * _MARGIN
    spread = max(high[0] - low[0], (high[1] - low[1]) * room[0] / room[1], _LEAST_WIDTH_M)
    scale, middle = room[0] / spread, (low + high) / 2

    def drawn(world: Points) -> Points:
        return np.stack(
            [WIDTH / 2 + scale * (world[:, 0] - middle[0]), HEIGHT / 2 - scale * (world[:, 1] - middle[1])], axis=1
        )

    strokes = []
    for future, line in zip(scene.futures, futures, strict=True):
        strokes.append(_stroke(future, drawn(line), drawn(placed(future.x_m, future.y_m))))
    half = scene.box_m[0] / 2, scene.box_m[1] / 2
    corners = np.array([[half[0], half[1]], [half[0], -half[1]], [-half[0], -half[1]], [-half[0], half[1]]])
    lanes = []
    for element in elements:
        if element["kind"] in ("lane", "road_area") and element["x_m"].size:
            line = drawn(placed(element["x_m"], element["y_m"]))
            if _is_seen(line):
                width = 0 if element["kind"] == "road_area" else round(scale * float(np.mean(element["width_m"])))
                lanes.append((max(width, 1) if width or element["kind"] == "lane" else 0, _path(line)))
    return Thumbnail(lanes, [*strokes[1:], strokes[0]], f"{_path(drawn(corners))}z")


def _stroke(future: Future, line: Points, every: Points) -> Stroke:
    contacts = future.contacts
    contact = tuple(int(value) for value in np.rint(every[contacts[0]])) if len(contacts) else None
    return Stroke(future.policy.family, _path(line), contact)  # type: ignore[arg-type]


def _is_seen(line: Points) -> bool:
    low, high = line.min(axis=0), line.max(axis=0)
    return bool(high[0] >= -20 and low[0] <= WIDTH + 20 and high[1] >= -20 and low[1] <= HEIGHT + 20)


def _path(line: Points) -> str:
    """Data of a path through whole numbers, without points that add nothing and far from the drawing."""
    clipped = np.clip(np.rint(line), -2 * WIDTH, 3 * WIDTH).astype(np.int64)
    kept = np.concatenate([[True], (np.diff(clipped, axis=0) != 0).any(axis=1)])
    clipped = _straightened(clipped[kept])
    steps = np.diff(clipped, axis=0).tolist()
    head = f"M{clipped[0][0]} {clipped[0][1]}"
    return head + "".join(f"l{dx} {dy}" for dx, dy in steps)


def _straightened(points: NDArray[np.int64]) -> NDArray[np.int64]:
    """Points without those that lie within half a unit of the line of their neighbours that are kept."""
    kept, anchor = [0], 0
    for at in range(2, len(points)):
        between = points[anchor + 1 : at] - points[anchor]
        along = points[at] - points[anchor]
        length = math.hypot(*along.tolist())
        off = np.abs(between[:, 0] * along[1] - between[:, 1] * along[0]) / max(length, 1e-9)
        if (off > 0.6).any() or (length == 0 and len(between)):
            kept.append(at - 1)
            anchor = at - 1
    if len(points) > 1:
        kept.append(len(points) - 1)
    return points[kept]
