"""What stands on the ground as boxes: actors, signals, signs and walls, in the ego's frame.

An actor is a few boxes inside its recorded one: a car has a body, a cabin, wheels and lamps, a person legs, a trunk
and a head. Far away it has its large boxes alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive_reference.rendering.marking import Pieces
from branchdrive_reference.rendering.palette import LAMPS, SURFACES, Colour, bgr, paint_of
from branchdrive_reference.rendering.patch import Post

__all__ = ["FACES", "Bodies", "Parts", "actor_parts", "post_parts", "shadows", "wall_parts"]

Array = NDArray[np.float64]

FACES = np.array([[0, 3, 7, 4], [0, 1, 5, 4], [1, 2, 6, 5], [3, 2, 6, 7], [4, 5, 6, 7]])
"""Corners of the front, left, rear, right and upper face of a box, by `Parts.corners` ``[5, 4]``."""

_FRONT, _LEFT, _REAR, _RIGHT, _TOP = range(5)
_ALL = (_FRONT, _LEFT, _REAR, _RIGHT, _TOP)
_SIDES = (_LEFT, _RIGHT)

_PAINT: Colour = (-1, -1, -1)
"""Stands for the colour of the actor."""

_GLASS, _TYRE, _SKIN, _CLOTH, _WHITE, _METAL = map(
    bgr, ("#27313d", "#1b1c1f", "#d9a98a", "#2f3542", "#f2f2ee", "#7d838b")
)
_TAIL, _HEAD, _UNLIT, _CASE = map(bgr, ("#e0241b", "#fff3c4", "#34373c", "#1e2126"))


class _Shape(NamedTuple):
    """A box inside the box of an actor, in shares of its length, width and height."""

    ahead: float
    left: float
    length: float
    width: float
    low: float
    high: float
    side: Colour
    top: Colour
    faces: Sequence[int] = _ALL
    glows: bool = False


_LAMPS = (
    *(_Shape(-0.5, y, 0.02, 0.22, 0.36, 0.5, _TAIL, _TAIL, (_REAR,), True) for y in (-0.36, 0.36)),
    *(_Shape(0.5, y, 0.02, 0.22, 0.34, 0.46, _HEAD, _HEAD, (_FRONT,), True) for y in (-0.36, 0.36)),
)
_WHEELS = tuple(_Shape(x, 0, 0.15, 1.01, 0, 0.4, _TYRE, _TYRE, _SIDES) for x in (-0.3, 0.3))
_CAR = (
    _Shape(0, 0, 1, 1, 0.13, 0.58, _PAINT, _PAINT),
    _Shape(-0.06, 0, 0.56, 0.88, 0.58, 1, _GLASS, _PAINT),
)
_VAN = (_Shape(0, 0, 1, 1, 0.1, 1, _PAINT, _PAINT),)
_VAN_WINDOWS = (
    _Shape(0.5, 0, 0.02, 0.86, 0.54, 0.88, _GLASS, _GLASS, (_FRONT,)),
    _Shape(0.36, 0, 0.2, 1.01, 0.54, 0.86, _GLASS, _GLASS, _SIDES),
    _Shape(-0.5, 0, 0.02, 0.7, 0.58, 0.86, _GLASS, _GLASS, (_REAR,)),
)
_CYCLE = (
    _Shape(0, 0, 1, 0.14, 0, 0.45, _TYRE, _TYRE),
    _Shape(-0.06, 0, 0.3, 0.7, 0.4, 0.86, _PAINT, _PAINT),
    _Shape(-0.02, 0, 0.14, 0.34, 0.86, 1, _SKIN, _CLOTH),
)
_PEDESTRIAN = (
    _Shape(0, 0, 0.55, 0.65, 0, 0.5, _CLOTH, _CLOTH),
    _Shape(0, 0, 0.75, 1, 0.48, 0.84, _PAINT, _PAINT),
    _Shape(0, 0, 0.5, 0.42, 0.86, 1, _SKIN, _CLOTH),
)
_STATIC = (_Shape(0, 0, 1, 1, 0, 1, _PAINT, _PAINT),)
_BAND = (_Shape(0, 0, 1.01, 1.01, 0.5, 0.72, _WHITE, _WHITE, (_FRONT, *_SIDES, _REAR)),)

_VAN_HEIGHT_M = 1.9
_POST_HEIGHT_M = 2.0
_SHADOW_M = 0.25
"""By how much a shadow is longer and wider than its actor."""

_POLE_M, _PLATE_M = 0.12, 0.8
_WALL_HEIGHT_M = 1.1


@dataclass(frozen=True, eq=False)
class Bodies:
    """Actors in the ego's frame; arrays ``[actors]``, and length, width and height ``[actors, 3]``."""

    actor_class: Sequence[str]
    x_m: Array
    y_m: Array
    yaw_rad: Array
    extents_m: Array

    def with_ego(self, length_m: float, width_m: float, height_m: float) -> Bodies:
        """The same actors and the ego."""
        own = np.array([[length_m, width_m, height_m]])
        x, y, yaw = (np.append(values, 0.0) for values in (self.x_m, self.y_m, self.yaw_rad))
        return Bodies([*self.actor_class, "vehicle"], x, y, yaw, np.concatenate([self.extents_m, own]))


@dataclass(frozen=True, eq=False)
class Parts:
    """Upright boxes in the ego's frame; arrays ``[parts]``, colours ``[parts, 3]``, faces ``[parts, 5]``.

    Boxes that glow are lamps: they have their colour in any light.
    """

    x_m: Array
    y_m: Array
    yaw_rad: Array
    length_m: Array
    width_m: Array
    low_m: Array
    high_m: Array
    side: Array
    top: Array
    has_face: NDArray[np.bool_]
    glows: NDArray[np.bool_]
    distance_m: Array

    @classmethod
    def joined(cls, groups: Sequence[Parts]) -> Parts:
        """All parts of some."""
        return cls(*(np.concatenate([getattr(one, field.name) for one in groups]) for field in fields(cls)))

    def far_to_near(self, first: int) -> Parts:
        """The same parts, after the first few those of far actors first; parts of one actor keep their order."""
        order = np.arange(len(self))
        order[first:] = first + np.argsort(-self.distance_m[first:], kind="stable")
        return Parts(*(getattr(self, field.name)[order] for field in fields(self)))

    def corners(self) -> Array:
        """Corners ``[parts, 8, 3]``: front left, rear left, rear right, front right, below and then above."""
        along = self.length_m[:, None] / 2 * np.array([1, -1, -1, 1])
        left = self.width_m[:, None] / 2 * np.array([1, 1, -1, -1])
        cos, sin = np.cos(self.yaw_rad)[:, None], np.sin(self.yaw_rad)[:, None]
        corners = np.empty((len(self.x_m), 8, 3))
        corners[:, :4, 0] = corners[:, 4:, 0] = self.x_m[:, None] + cos * along - sin * left
        corners[:, :4, 1] = corners[:, 4:, 1] = self.y_m[:, None] + sin * along + cos * left
        corners[:, :4, 2] = self.low_m[:, None]
        corners[:, 4:, 2] = self.high_m[:, None]
        return corners

    def __len__(self) -> int:
        return len(self.x_m)


@dataclass(frozen=True, eq=False)
class _Table:
    """Shapes as arrays ``[shapes]``."""

    shares: Array
    side: Array
    top: Array
    has_face: NDArray[np.bool_]
    glows: NDArray[np.bool_]

    @classmethod
    def of(cls, shapes: Sequence[_Shape]) -> _Table:
        has_face = np.array([[face in shape.faces for face in _ALL] for shape in shapes])
        return cls(
            np.array([shape[:6] for shape in shapes], float),
            np.array([shape.side for shape in shapes], float),
            np.array([shape.top for shape in shapes], float),
            has_face,
            np.array([shape.glows for shape in shapes]),
        )


_TABLES: Mapping[str, tuple[_Table, _Table, _Table]] = MappingProxyType(
    {
        name: (_Table.of(large), _Table.of((*large, *lamps)), _Table.of((*large, *small, *lamps)))
        for name, large, small, lamps in (
            ("car", _CAR, _WHEELS, _LAMPS),
            ("van", _VAN, (*_VAN_WINDOWS, *_WHEELS), _LAMPS),
            ("cycle", _CYCLE, (), ()),
            ("pedestrian", _PEDESTRIAN, (), ()),
            ("static", _STATIC, _BAND, ()),
            ("post", _STATIC, (), ()),
        )
    }
)
"""Shapes of an actor far away, far away with its lamps on, and nearby."""


def _kind(actor_class: str, height_m: float) -> str:
    if actor_class == "vehicle":
        return "van" if height_m > _VAN_HEIGHT_M else "car"
    if actor_class == "static":
        return "post" if height_m > _POST_HEIGHT_M else "static"
    return actor_class


def actor_parts(bodies: Bodies, detail_m: float, *, has_lamps_on: bool) -> Parts:
    """Parts of actors; those that are nearer than `detail_m` have their small ones, the others lamps that are on."""
    distance = np.hypot(bodies.x_m, bodies.y_m)
    levels = np.where(distance < detail_m, 2, int(has_lamps_on)).tolist()
    names = zip(bodies.actor_class, bodies.extents_m.tolist(), levels, strict=True)
    chosen = [(_TABLES[_kind(name, extents[2])][level], _paint(name, *extents)) for name, extents, level in names]
    if not chosen:
        return _none()
    owner = np.repeat(np.arange(len(chosen)), [len(table.shares) for table, _ in chosen])
    shares, side, top, has_face, glows = (
        np.concatenate([getattr(table, field.name) for table, _ in chosen]) for field in fields(_Table)
    )
    paint = np.array([colour for _, colour in chosen], float)[owner]
    length, width, height = bodies.extents_m[owner].T
    x, y, yaw = bodies.x_m[owner], bodies.y_m[owner], bodies.yaw_rad[owner]
    ahead, left = shares[:, 0] * length, shares[:, 1] * width
    cos, sin = np.cos(yaw), np.sin(yaw)
    return Parts(
        x + cos * ahead - sin * left,
        y + sin * ahead + cos * left,
        yaw,
        shares[:, 2] * length,
        shares[:, 3] * width,
        shares[:, 4] * height,
        shares[:, 5] * height,
        np.where(side < 0, paint, side),
        np.where(top < 0, paint, top),
        has_face,
        glows,
        distance[owner],
    )


@lru_cache(maxsize=1024)
def _paint(actor_class: str, length_m: float, width_m: float, height_m: float) -> Colour:
    is_post = actor_class == "static" and height_m > _POST_HEIGHT_M
    return _METAL if is_post else paint_of(actor_class, length_m, width_m, height_m)


def _none() -> Parts:
    none, colours = np.zeros(0), np.zeros((0, 3))
    return Parts(
        none, none, none, none, none, none, none, colours, colours, np.zeros((0, 5), bool), np.zeros(0, bool), none
    )


def shadows(bodies: Bodies, reach_m: float) -> Parts:
    """What darkens the ground below actors that are nearer than `reach_m`."""
    distance = np.hypot(bodies.x_m, bodies.y_m)
    near = distance < reach_m
    count = int(near.sum())
    colour = np.tile(np.array(SURFACES["shadow"], float), (count, 1))
    has_face = np.tile(np.array([False, False, False, False, True]), (count, 1))
    length, width, _ = bodies.extents_m[near].T
    return Parts(
        bodies.x_m[near], bodies.y_m[near], bodies.yaw_rad[near], length + _SHADOW_M, width + _SHADOW_M,
        np.zeros(count), np.full(count, 0.01), colour, colour, has_face, np.zeros(count, bool), distance[near],
    )  # fmt: skip


_Box = tuple[float, float, float, float, float, float, Colour, bool]


def _upright(rows: Sequence[_Box]) -> Parts:
    """Boxes along the axes of the ego's frame: x, y, length, width, low, high and colour of each, whether it glows."""
    numbers = np.array([row[:6] for row in rows], float).reshape(-1, 6)
    colours = np.array([row[6] for row in rows], float).reshape(-1, 3)
    x, y, length, width, low, high = numbers.T
    faces, glows = np.ones((len(rows), 5), bool), np.array([row[7] for row in rows], bool)
    return Parts(x, y, np.zeros(len(rows)), length, width, low, high, colours, colours, faces, glows, np.hypot(x, y))


def post_parts(posts: Sequence[Post], places_m: Array, lit: Mapping[int, str]) -> Parts:
    """Signals and signs at places of the ego's frame ``[posts, 2]``; `lit` has states of signals by their number."""
    rows: list[_Box] = []
    for number, (post, (x, y)) in enumerate(zip(posts, places_m.tolist(), strict=True)):
        rows.append((x, y, _POLE_M, _POLE_M, 0.0, 2.6, _METAL, False))
        if post.kind == "signal":
            rows.append((x, y, 0.3, 0.4, 2.3, 3.5, _CASE, False))
            for height, state in ((3.12, "red"), (2.74, "yellow"), (2.36, "green")):
                is_lit = lit.get(number) == state
                rows.append((x, y, 0.34, 0.3, height, height + 0.3, LAMPS[state] if is_lit else _UNLIT, is_lit))
        else:
            is_stop = post.kind == "stop_sign"
            low, high = (2.15, 2.45) if is_stop else (2.05, 2.5)
            rows.append((x, y, 0.06, _PLATE_M, 1.9, 1.9 + _PLATE_M, _TAIL, False))
            rows.append((x, y, 0.08, 0.6 if is_stop else 0.45, low, high, _WHITE, False))
    return _upright(rows)


def wall_parts(walls: Pieces, start_m: Array, end_m: Array) -> Parts:
    """Walls between places of the ego's frame ``[pieces, 2]``."""
    middle, along = (start_m + end_m) / 2, end_m - start_m
    count = len(walls)
    colour = np.tile(np.array(SURFACES["wall"], float), (count, 1))
    return Parts(
        middle[:, 0], middle[:, 1], np.arctan2(along[:, 1], along[:, 0]), np.hypot(*along.T), walls.width_m,
        np.zeros(count), np.full(count, _WALL_HEIGHT_M), colour, colour, np.ones((count, 5), bool),
        np.zeros(count, bool), np.hypot(*middle.T),
    )  # fmt: skip
