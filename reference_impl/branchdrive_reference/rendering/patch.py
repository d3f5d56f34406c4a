"""A square of the world around a tile of 64 m, ready to be drawn: what the ground is, its looks, and what stands there.

A patch is a function of the map and of the number of its tile alone: an ego within the tile sees no farther than its
edges. What rollouts of a group do later cannot reach into an image.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.semantic_bev import PX_PER_M as BEV_PX_PER_M
from branchdrive.contract.semantic_bev import SemanticChannel, SemanticClass
from branchdrive_reference.geometry.polyline import Array, Polyline
from branchdrive_reference.rendering.cropping import cropped
from branchdrive_reference.rendering.marking import Pieces, kerb_pieces, painted_pieces, zebra_pieces
from branchdrive_reference.rendering.opencv import SUBPIXEL_BITS, Image, cv2, fixed_point
from branchdrive_reference.rendering.palette import SURFACES, Daylight
from branchdrive_reference.town.elements import Element

__all__ = ["PX_PER_M", "TILE_M", "Patch", "Post", "Tile", "Town", "governing_signal"]

TILE_M = 64.0
_MARGIN_M = 128.0
"""How far a patch reaches beyond its tile."""

PX_PER_M = 4
_COARSE = 4
"""The distance is drawn from a ground whose pixels are this many times as large, or it would flicker."""

_REACH_M = 20.0
"""Half the width of a strip at most, and of what lies beside it."""

_LONG_M = 2000.0
"""An element that reaches farther beyond a patch is cropped: drawing knows no points that are 4 km away."""

_FAR_PAINT_M = 0.4
"""Width of lines in the distance: as wide as they are, they would be too faint to be seen."""

_SIDE_PX = int((TILE_M + 2 * _MARGIN_M) * PX_PER_M)

NOTHING, ROAD, PARKING, SHOULDER, SIDEWALK, KERB = range(6)
"""What a pixel of the ground is."""

_LOOKS = ("grass", "road", "parking", "shoulder", "sidewalk", "kerb")
_ROUGHNESS = (24.0, 7.0, 7.0, 7.0, 6.0, 3.0)
"""Largest change of brightness by noise, for each kind of ground."""

_SIDEWALK_M = 2.2
_TOWN_LIMIT_MPS = 17.0
"""Roads of at most this limit have pavements at their sides, which no map records."""

_AHEAD_M, _ASIDE_M = 70.0, 14.0
"""Where a signal stands that governs the ego's lane and does not name it."""

_STRIPS = {"lane": ROAD, "parking": PARKING, "shoulder": SHOULDER}
_POSTS = ("signal", "stop_sign", "yield_sign")


class Tile(NamedTuple):
    """A square of the world by its column and row."""

    column: int
    row: int

    @classmethod
    def of(cls, x_m: float, y_m: float) -> Tile:
        """The tile that holds a point."""
        return cls(math.floor(x_m / TILE_M), math.floor(y_m / TILE_M))


class Post(NamedTuple):
    """A signal or sign."""

    kind: str
    lane_id: str | None
    x_m: float
    y_m: float


@dataclass(frozen=True, eq=False)
class Patch:
    """The world around one tile.

    Attributes:
        tile: The tile.
        elements: Elements of the map that reach into the patch.
    """

    tile: Tile
    elements: tuple[Element, ...]

    @property
    def origin_m(self) -> Array:
        """The corner of the patch with the least coordinates, world frame ``[2]``."""
        return np.array([self.tile.column * TILE_M - _MARGIN_M, self.tile.row * TILE_M - _MARGIN_M])

    @cached_property
    def to_world(self) -> Array:
        """Pixels ``(column, row, 1)`` of `ground` to world points ``(x, y, 1)``, by their centres ``[3, 3]``."""
        step_m = 1.0 / PX_PER_M
        x, y = self.origin_m + step_m / 2
        return np.array([[step_m, 0, x], [0, step_m, y], [0, 0, 1.0]])

    def _px(self, x_m: Array, y_m: Array) -> NDArray[np.int32]:
        return fixed_point((np.stack([x_m, y_m], axis=-1) - self.origin_m) * PX_PER_M)

    @cached_property
    def ground(self) -> Image:
        """What the ground is ``[rows, columns]``: rows along y, columns along x, both growing."""
        ground = np.full((_SIDE_PX, _SIDE_PX), NOTHING, np.uint8)
        lanes = [one for one in self.elements if one["kind"] in _STRIPS]
        areas = [one for one in self.elements if one["kind"] == "road_area"]
        urban = [one for one in lanes if _is_urban(one)]
        for lane in urban:
            self._fill_strip(ground, lane, SIDEWALK, 2 * _SIDEWALK_M)
        for area in areas if urban else ():
            outline = self._px(area["x_m"], area["y_m"])
            thickness = round(2 * _SIDEWALK_M * PX_PER_M)
            cv2.polylines(ground, [outline], True, SIDEWALK, thickness, cv2.LINE_8, SUBPIXEL_BITS)
        for kind, value in (("shoulder", SHOULDER), ("parking", PARKING), ("lane", ROAD)):
            for strip in lanes:
                if strip["kind"] == kind:
                    self._fill_strip(ground, strip, value, -1.0 / PX_PER_M)
        for area in areas:
            cv2.fillPoly(ground, [self._px(area["x_m"], area["y_m"])], ROAD, cv2.LINE_8, SUBPIXEL_BITS)
        return ground

    @cached_property
    def semantics(self) -> Image:
        """The ground as pixels of a semantic view: road, paint and drivable area; no map has sidewalks.

        Paint is as wide as a pixel of a view, or a view would miss it ``[rows, columns]``.
        """
        table = np.zeros(256, np.uint8)
        table[[ROAD, PARKING, SHOULDER]] = SemanticClass.ROAD | SemanticChannel.DRIVABLE_AREA
        semantics = np.asarray(cv2.LUT(self.ground, table))
        lines = np.zeros(semantics.shape, np.uint8)
        for outline in self._widened_paint(1.0 / BEV_PX_PER_M):
            cv2.fillConvexPoly(lines, outline, 1, cv2.LINE_8, SUBPIXEL_BITS)
        semantics[lines > 0] &= ~np.uint8(SemanticClass.ROAD)
        semantics[lines > 0] |= np.uint8(SemanticClass.LANE_MARKING)
        return semantics

    def _widened_paint(self, least_m: float) -> NDArray[np.int32]:
        """Outlines of painted lines of at least a width, in pixels as drawing takes them ``[pieces, 4, 2]``."""
        filled_m = np.maximum(self.paint.width_m, least_m) - 1.0 / PX_PER_M  # filling adds half a pixel at the edges
        wide = Pieces(self.paint.start_m, self.paint.end_m, np.maximum(filled_m, 0.0))
        return self._px(*np.moveaxis(wide.corners(), -1, 0))

    @cached_property
    def stop_lines(self) -> Mapping[str, tuple[Array, ...]]:
        """Lines at which vehicles wait, each ``[vertices, 2]``, by the lane that they cross."""
        lines: dict[str, tuple[Array, ...]] = {}
        for one in self.elements:
            lane_id = one.get("lane_id")
            if one["kind"] == "stop_line" and lane_id is not None:
                lines[lane_id] = (*lines.get(lane_id, ()), np.stack([one["x_m"], one["y_m"]], axis=1))
        return lines

    def _fill_strip(self, ground: Image, strip: Element, value: int, wider_m: float) -> None:
        line, half = Polyline(strip["x_m"], strip["y_m"]), (strip["width_m"] + wider_m) / 2
        left, right = line.shifted(half), line.shifted(-half)
        sides = np.stack([self._px(left.x_m, left.y_m), self._px(right.x_m, right.y_m)], axis=1)
        for quad in np.concatenate([sides[:-1], sides[1:, ::-1]], axis=1):
            cv2.fillConvexPoly(ground, quad, value, cv2.LINE_8, SUBPIXEL_BITS)

    @cached_property
    def paint(self) -> Pieces:
        """Painted lines and the stripes of crossings."""
        crossings = (zebra_pieces(one) for one in self.elements if one["kind"] == "crossing")
        return Pieces.joined([*map(painted_pieces, self.elements), *crossings])

    @cached_property
    def paint_corners(self) -> Array:
        """Outlines of the painted lines ``[pieces, 4, 2]``."""
        return self.paint.corners()

    @cached_property
    def walls(self) -> Pieces:
        """What a body can hit, as lines."""
        return Pieces.joined(kerb_pieces(one, 0.3) for one in self.elements if one["kind"] == "wall")

    @cached_property
    def posts(self) -> tuple[Post, ...]:
        """Signals and signs."""
        return tuple(
            Post(one["kind"], one.get("lane_id"), float(one["x_m"][0]), float(one["y_m"][0]))
            for one in self.elements
            if one["kind"] in _POSTS
        )

    @property
    def coarse_to_world(self) -> Array:
        """The same for pixels of the coarse texture of `looks` ``[3, 3]``."""
        step_m = _COARSE / PX_PER_M
        x, y = self.origin_m + step_m / 2
        return np.array([[step_m, 0, x], [0, step_m, y], [0, 0, 1.0]])

    @cached_property
    def post_places_m(self) -> Array:
        """Where signals and signs stand ``[posts, 2]``."""
        return np.array([[post.x_m, post.y_m] for post in self.posts]).reshape(-1, 2)

    def looks(self, light: Daylight) -> tuple[Image, Image]:
        """The ground in a light as a texture, fine and coarse ``[rows, columns, 3]``.

        Paint is part of the coarse one alone: nearby it is drawn at the resolution of an image.
        """
        ground = self.ground.copy()
        paved = np.asarray((ground != NOTHING) & (ground != SIDEWALK), np.uint8)
        rim = cv2.dilate(paved, np.ones((3, 3), np.uint8))
        ground[(rim > 0) & (ground == SIDEWALK)] = KERB
        kerbs = Pieces.joined(kerb_pieces(one, 0.2) for one in self.elements if one["kind"] == "kerb")
        lines = np.stack([kerbs.start_m, kerbs.end_m], axis=1)
        cv2.polylines(ground, list(self._px(lines[..., 0], lines[..., 1])), False, KERB, 1, cv2.LINE_8, SUBPIXEL_BITS)
        table = np.zeros((256, 1, 3), np.uint8)
        for value, name in enumerate(_LOOKS):
            table[value] = np.rint(light.lit(np.array(SURFACES[name], float)))
        colours = cv2.LUT(cv2.cvtColor(ground, cv2.COLOR_GRAY2BGR), table)
        rough = np.zeros(256, np.float32)
        rough[: len(_ROUGHNESS)] = np.array(_ROUGHNESS) * light.ambient / 127.0
        repeats = -(-_SIDE_PX // len(_noise()))
        speckle = np.tile(_noise(), (repeats, repeats))[:_SIDE_PX, :_SIDE_PX] * rough[ground]
        fine = cv2.add(colours, cv2.cvtColor(speckle, cv2.COLOR_GRAY2BGR), dtype=cv2.CV_8U)
        painted = fine.copy()
        colour = np.rint(light.lit(np.array(SURFACES["paint"], float))).tolist()
        for outline in self._widened_paint(_FAR_PAINT_M):
            cv2.fillConvexPoly(painted, outline, colour, cv2.LINE_8, SUBPIXEL_BITS)
        coarse = cv2.resize(painted, None, fx=1 / _COARSE, fy=1 / _COARSE, interpolation=cv2.INTER_AREA)
        return fine, coarse


def _is_urban(strip: Element) -> bool:
    limit = strip.get("speed_limit_mps")
    return strip["kind"] == "parking" or (strip["kind"] == "lane" and (limit is None or limit <= _TOWN_LIMIT_MPS))


@lru_cache(maxsize=1)
def _noise() -> NDArray[np.float32]:
    """Noise of -127 to 127, fine and in clouds of some metres, that repeats at the edges of a tile ``[256, 256]``."""
    side = int(TILE_M * PX_PER_M)
    row, column = np.mgrid[:side, :side].astype(np.uint32)
    fine = _hashed(row, column)
    cloud = np.zeros((side, side), np.float32)
    for share, cell in ((0.6, 32), (0.4, 8)):
        few = _hashed(*(axis[::cell, ::cell] + np.uint32(side * cell) for axis in (row, column)))
        wrapped = np.pad(few, 2, mode="wrap")
        whole = cv2.resize(wrapped, None, fx=cell, fy=cell, interpolation=cv2.INTER_CUBIC)
        cloud += share * whole[2 * cell : -2 * cell, 2 * cell : -2 * cell]
    return np.asarray(0.3 * fine + 0.7 * cloud, np.float32)


def _hashed(row: NDArray[np.uint32], column: NDArray[np.uint32]) -> NDArray[np.float32]:
    """A number of -127 to 127 for each pixel, a function of its row and column alone."""
    word = row * np.uint32(0x9E3779B1) ^ column * np.uint32(0x85EBCA77)
    for shift, factor in ((15, 0x2C1B3C6D), (12, 0x297A2D39)):
        word = (word ^ (word >> np.uint32(shift))) * np.uint32(factor)
    return np.asarray((word >> np.uint32(24)).astype(np.float32) - 127.5, np.float32)


class Town:
    """The recorded map of a town, in patches that are made when they are needed.

    Args:
        elements: Elements of its map.
    """

    _MOST_PATCHES = 8

    def __init__(self, elements: Sequence[Element]) -> None:
        self._elements = tuple(elements)
        self._low = np.array([[one["x_m"].min(), one["y_m"].min()] for one in elements]).reshape(-1, 2)
        self._high = np.array([[one["x_m"].max(), one["y_m"].max()] for one in elements]).reshape(-1, 2)
        self.patch = lru_cache(maxsize=self._MOST_PATCHES)(self._patch)

    def _patch(self, tile: Tile) -> Patch:
        """The world around a tile."""
        empty = Patch(tile, ())
        low, high = empty.origin_m - _REACH_M, empty.origin_m + _SIDE_PX / PX_PER_M + _REACH_M
        meets = ((self._low <= high) & (self._high >= low)).all(axis=1)
        is_long = np.any((self._low < low - _LONG_M) | (self._high > high + _LONG_M), axis=1)
        parts = (
            cropped(self._elements[row], low, high) if is_long[row] else (self._elements[row],)
            for row in np.flatnonzero(meets)
        )
        return Patch(tile, tuple(chain.from_iterable(parts)))


def governing_signal(posts: tuple[Post, ...], places_m: Array, lane_id: str | None) -> int | None:
    """Which signal governs the ego's lane: that of the lane, or else the nearest one ahead.

    Args:
        posts: Signals and signs.
        places_m: Where they are in the ego's frame ``[posts, 2]``.
        lane_id: The ego's lane.
    """
    signals = [number for number, post in enumerate(posts) if post.kind == "signal"]
    own = [number for number in signals if lane_id is not None and posts[number].lane_id == lane_id]
    ahead = [i for i in signals if 0 < places_m[i, 0] < _AHEAD_M and abs(places_m[i, 1]) < _ASIDE_M]
    return min(own or ahead, key=lambda i: (float(np.hypot(*places_m[i])), i), default=None)
