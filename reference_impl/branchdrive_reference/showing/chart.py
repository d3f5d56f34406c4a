"""The bird's-eye view as a picture: classes in colours, and the futures of every candidate on top.

Where no semantic view was recorded, or where it ends, the same is drawn from the map and the recorded state.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from branchdrive.contract.camera import TopDownCamera
from branchdrive.contract.semantic_bev import (
    BEV_CAMERA,
    PX_PER_M,
    SEMANTIC_STREAM,
    SemanticChannel,
    SemanticClass,
    classes_of,
)
from branchdrive.contract.timing import ACTIVE_TICKS
from branchdrive_reference.drawing.palette import ACTORS, BACKDROP, Rgb
from branchdrive_reference.drawing.scene import Array, Candidate, DrawnScene
from branchdrive_reference.rendering.marking import Pieces
from branchdrive_reference.rendering.patch import Tile, Town
from branchdrive_reference.rendering.semantic import SemanticView
from branchdrive_reference.rendering.snapshot import Playback, Snapshot

__all__ = ["Chart", "coloured", "ink"]

_CLASSES: Mapping[SemanticClass, str] = {
    SemanticClass.NOTHING: "#dfe5d8",
    SemanticClass.ROAD: "#b9bdc4",
    SemanticClass.SIDEWALK: "#d9d3c7",
    SemanticClass.LANE_MARKING: "#ffffff",
    SemanticClass.STOP_SIGN: "#a11d33",
    SemanticClass.RED_LIGHT: "#e5383b",
    SemanticClass.YELLOW_LIGHT: "#ffc21a",
    SemanticClass.GREEN_LIGHT: "#2bb673",
    SemanticClass.VEHICLE: "#4f6d94",
    SemanticClass.PEDESTRIAN: "#b8860b",
}
_ROUTE, _EGO = np.array([0x9A, 0x86, 0xD8]), np.array([0x11, 0x14, 0x18])
_ROUTE_SHARE = 0.35

_LEAST_M, _MOST_M, _MARGIN_M = 56.0, 124.0, 12.0
_BEHIND = 0.32
"""Share of a chart that lies behind the ego."""

_FINE = 3
"""Lines are drawn this many times as large and made smaller, which smooths them."""


def ink(colour: Rgb) -> tuple[int, int, int]:
    """A colour of the palette, as Pillow takes it."""
    red, green, blue = (round(255 * channel) for channel in colour)
    return red, green, blue


def coloured(values: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A semantic view ``[height, width]`` in colours ``[height, width, 3]``."""
    table = np.zeros((16, 3))
    for kind, code in _CLASSES.items():
        table[kind] = [int(code[at : at + 2], 16) for at in (1, 3, 5)]
    colours = table[classes_of(values)]
    route = (values & SemanticChannel.REMAINING_ROUTE) != 0
    colours[route] = (1 - _ROUTE_SHARE) * colours[route] + _ROUTE_SHARE * _ROUTE
    colours[(values & SemanticChannel.EGO) != 0] = _EGO
    return np.asarray(np.rint(colours), np.uint8)


@dataclass(frozen=True)
class Chart:
    """A square of the world around the nominal ego, its heading up.

    Attributes:
        scene: The group.
        recording: Its nominal rollout.
        colours: Colour of each candidate by its key.
        side_px: Rows and columns of the chart.
        camera: Declaration of the semantic view; ``None`` where there is none.
    """

    scene: DrawnScene
    recording: Playback
    colours: Mapping[str, Rgb]
    side_px: int
    camera: TopDownCamera | None

    @property
    def side_m(self) -> float:
        """Length of a side: enough for every future."""
        nominal, row = self.scene.nominal, self.scene.branch_row
        x, y = float(nominal.x_m[row]), float(nominal.y_m[row])
        ways = [np.hypot(one.x_m[one.future] - x, one.y_m[one.future] - y).max() for one in self.scene.candidates]
        return min(max((float(max(ways)) + _MARGIN_M) / (1 - _BEHIND), _LEAST_M), _MOST_M)

    def picture(self, tick: int, view: NDArray[np.uint8] | None) -> Image.Image:
        """The chart at a tick since the branch, on the semantic view of the nominal at that tick, if there is one.

        Where the view ends, the world is drawn from what is recorded. Up to the branch all futures are shown whole,
        after it as far as they have come: the longest first, so that none is hidden by one along the same way.
        """
        state = self.recording.at(tick + self.scene.record["branch_tick"])
        canvas = self._ground(state, view)
        draw = ImageDraw.Draw(canvas)
        self._draw_objects(draw, state)
        shown = tick if tick > 0 else ACTIVE_TICKS
        candidates = sorted(self.scene.candidates, key=lambda one: _way_m(one, shown), reverse=True)
        for draw_part in (self._draw_future, self._draw_end, self._draw_touches):
            for candidate in candidates:
                draw_part(draw, candidate, state, shown)
        return canvas.resize((self.side_px, self.side_px), Image.Resampling.LANCZOS)

    @property
    def _around(self) -> TopDownCamera:
        """A semantic view as large as the chart."""
        ahead, aside = (math.ceil(PX_PER_M * self.side_m * share) for share in (1 - _BEHIND, 0.5))
        behind = math.ceil(PX_PER_M * self.side_m * _BEHIND)
        return TopDownCamera(
            name=BEV_CAMERA,
            stream=SEMANTIC_STREAM,
            width_px=2 * aside,
            height_px=ahead + behind,
            px_per_m=PX_PER_M,
            origin_row_px=ahead,
            origin_column_px=aside,
        )

    @cached_property
    def _town(self) -> Town:
        return Town(self.scene.elements)

    def _ground(self, state: Snapshot, view: NDArray[np.uint8] | None) -> Image.Image:
        around = self._around
        drawn = SemanticView(around).draw(self._town.patch(Tile.of(state.x_m, state.y_m)), state)
        ground = self._cut(Image.fromarray(coloured(drawn)), around, Image.Resampling.BICUBIC)
        if view is not None and self.camera is not None:
            shown = self._cut(Image.fromarray(coloured(view)), self.camera, Image.Resampling.BICUBIC)
            inside = self._cut(Image.new("L", (view.shape[1], view.shape[0]), 255), self.camera)
            ground.paste(shown, mask=inside)
            box = inside.getbbox()
            if box is not None:
                ImageDraw.Draw(ground).rectangle(box, outline=ink(BACKDROP["quiet"]), width=_FINE)
        return ground

    def _cut(
        self, image: Image.Image, camera: TopDownCamera, filter_: Image.Resampling = Image.Resampling.NEAREST
    ) -> Image.Image:
        """What the chart shows of an image of a camera; zeros where it ends."""
        side = self.side_px * _FINE
        scale = self.side_m * camera.px_per_m / side
        left = camera.origin_column_px - scale * side / 2
        top = camera.origin_row_px - scale * side * (1 - _BEHIND)
        return image.transform((side, side), Image.Transform.AFFINE, (scale, 0.0, left, 0.0, scale, top), filter_)

    def _px(self, x_m: Array, y_m: Array, state: Snapshot) -> list[tuple[float, float]]:
        cos, sin = math.cos(state.yaw_rad), math.sin(state.yaw_rad)
        ahead = cos * (x_m - state.x_m) + sin * (y_m - state.y_m)
        left = cos * (y_m - state.y_m) - sin * (x_m - state.x_m)
        scale = self.side_px * _FINE / self.side_m
        columns = self.side_px * _FINE / 2 - scale * left
        rows = self.side_px * _FINE * (1 - _BEHIND) - scale * ahead
        return list(zip(columns.tolist(), rows.tolist(), strict=True))

    def _draw_objects(self, draw: ImageDraw.ImageDraw, state: Snapshot) -> None:
        """Boxes of static objects, which have no class in a semantic view."""
        actors = state.actors
        is_static = actors.actor_class == "static"
        half_m = actors.length_m / 2 * np.stack([np.cos(actors.yaw_rad), np.sin(actors.yaw_rad)])
        middle_m = np.stack([actors.x_m, actors.y_m])
        boxes = Pieces((middle_m - half_m).T, (middle_m + half_m).T, actors.width_m).chosen(is_static)
        for corners in boxes.corners():
            draw.polygon(self._px(corners[:, 0], corners[:, 1], state), fill=ink(ACTORS["static"]))

    def _draw_future(self, draw: ImageDraw.ImageDraw, candidate: Candidate, state: Snapshot, until: int) -> None:
        rows = _shown(candidate, until)
        points = self._px(candidate.x_m[rows], candidate.y_m[rows], state)
        colour = ink(self.colours[candidate.policy.key])
        if len(points) > 1:
            draw.line(points, fill=colour, width=2 * _FINE, joint="curve")
        for at in points[1:]:
            _disc(draw, at, 2.0 * _FINE, colour)

    def _draw_end(self, draw: ImageDraw.ImageDraw, candidate: Candidate, state: Snapshot, until: int) -> None:
        rows = _shown(candidate, until)
        (at,) = self._px(candidate.x_m[rows][-1:], candidate.y_m[rows][-1:], state)
        _disc(draw, at, 3.2 * _FINE, ink(self.colours[candidate.policy.key]), outline="white")

    def _draw_touches(self, draw: ImageDraw.ImageDraw, candidate: Candidate, state: Snapshot, until: int) -> None:
        touches = candidate.contacts[candidate.tick[candidate.contacts] <= until]
        for at in self._px(candidate.x_m[touches], candidate.y_m[touches], state):
            _cross(draw, at, 5.0 * _FINE)


def _shown(candidate: Candidate, until: int) -> NDArray[np.bool_]:
    return np.asarray(candidate.future & (candidate.tick <= until))


def _way_m(candidate: Candidate, until: int) -> float:
    """Length of what is shown of a future."""
    rows = _shown(candidate, until)
    return float(np.hypot(np.diff(candidate.x_m[rows]), np.diff(candidate.y_m[rows])).sum())


def _disc(
    draw: ImageDraw.ImageDraw,
    at: tuple[float, float],
    radius: float,
    fill: tuple[int, int, int],
    outline: str | None = None,
) -> None:
    x, y = at
    draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=fill, outline=outline, width=_FINE)


def _cross(draw: ImageDraw.ImageDraw, at: tuple[float, float], reach: float) -> None:
    """How a touch is marked."""
    x, y = at
    for width, colour in ((4 * _FINE, "white"), (2 * _FINE, "#d00000")):
        draw.line((x - reach, y - reach, x + reach, y + reach), fill=colour, width=width)
        draw.line((x - reach, y + reach, x + reach, y - reach), fill=colour, width=width)
