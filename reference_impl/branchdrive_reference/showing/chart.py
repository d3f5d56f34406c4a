"""The bird's-eye view as a picture: classes in colours, and the futures of every candidate on top."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from branchdrive.contract.camera import TopDownCamera
from branchdrive.contract.semantic_bev import SemanticChannel, SemanticClass, classes_of
from branchdrive.contract.timing import ACTIVE_TICKS
from branchdrive_reference.drawing.palette import BACKDROP, Rgb
from branchdrive_reference.drawing.scene import Array, Candidate, Scene

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
        colours: Colour of each candidate by its key.
        side_px: Rows and columns of the chart.
        camera: Declaration of the semantic view; ``None`` where there is none.
    """

    scene: Scene
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

        Up to the branch all futures are shown whole, after it as far as they have come.
        """
        nominal = self.scene.nominal
        row = int(np.searchsorted(nominal.tick, tick))
        pose = (float(nominal.x_m[row]), float(nominal.y_m[row]), float(nominal.yaw_rad[row]))
        canvas = self._ground(view)
        draw = ImageDraw.Draw(canvas)
        shown = tick if tick > 0 else ACTIVE_TICKS
        if view is None:
            self._draw_route(draw, pose)
        for candidate in (*self.scene.candidates[1:], nominal):
            self._draw_future(draw, candidate, pose, shown)
        return canvas.resize((self.side_px, self.side_px), Image.Resampling.LANCZOS)

    def _ground(self, view: NDArray[np.uint8] | None) -> Image.Image:
        size = (self.side_px * _FINE, self.side_px * _FINE)
        if view is None or self.camera is None:
            return Image.new("RGB", size, ink(BACKDROP["ground"]))
        image = Image.fromarray(coloured(view))
        scale = self.side_m * self.camera.px_per_m / size[0]
        left = self.camera.origin_column_px - scale * size[0] / 2
        top = self.camera.origin_row_px - scale * size[1] * (1 - _BEHIND)
        nothing = _CLASSES[SemanticClass.NOTHING]
        cut = (scale, 0.0, left, 0.0, scale, top)
        return image.transform(size, Image.Transform.AFFINE, cut, Image.Resampling.BICUBIC, fillcolor=nothing)

    def _px(self, x_m: Array, y_m: Array, pose: tuple[float, float, float]) -> list[tuple[float, float]]:
        x, y, yaw = pose
        ahead = math.cos(yaw) * (x_m - x) + math.sin(yaw) * (y_m - y)
        left = math.cos(yaw) * (y_m - y) - math.sin(yaw) * (x_m - x)
        scale = self.side_px * _FINE / self.side_m
        columns = self.side_px * _FINE / 2 - scale * left
        rows = self.side_px * _FINE * (1 - _BEHIND) - scale * ahead
        return list(zip(columns.tolist(), rows.tolist(), strict=True))

    def _draw_route(self, draw: ImageDraw.ImageDraw, pose: tuple[float, float, float]) -> None:
        draw.line(self._px(*self.scene.route, pose), fill=ink(BACKDROP["route"]), width=2 * _FINE, joint="curve")

    def _draw_future(
        self, draw: ImageDraw.ImageDraw, candidate: Candidate, pose: tuple[float, float, float], until: int
    ) -> None:
        rows = candidate.future & (candidate.tick <= until)
        points = self._px(candidate.x_m[rows], candidate.y_m[rows], pose)
        colour = ink(self.colours[candidate.policy.key])
        if len(points) > 1:
            draw.line(points, fill=colour, width=2 * _FINE, joint="curve")
        for at in points[1:]:
            _disc(draw, at, 2.0 * _FINE, colour)
        _disc(draw, points[-1], 3.2 * _FINE, colour, outline="white")
        touches = candidate.contacts[candidate.tick[candidate.contacts] <= until]
        for at in self._px(candidate.x_m[touches], candidate.y_m[touches], pose):
            _cross(draw, at, 5.0 * _FINE)


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
