"""What lies under points of a town: strips around centre lines, and areas inside outlines.

A strip is all that lies within half its width of its centre line, the width taken linearly between vertices. The
excess of a point over a strip is its distance to the centre line less half the width there: negative inside.
Pairs of points and segments that can be near each other are found in a grid of square cells.

Source: spec/05-raw-streams.md#map.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Areas", "Strips", "TooLargeError"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

_CELL_M = 4.0
_PIECE_M = 8.0
"""Segments are filed piece by piece, or a long oblique one would be filed all over its bounding box."""

_MAX_ENTRIES = 4_000_000
"""Cells that pieces are filed in, together: they take 32 MB a column, and a town of 2,000 km of lanes fewer of them."""

_BLOCK_ROWS = 65_536
_BLOCK_PAIRS = 1_000_000
_OFFSET, _SPAN = 1 << 23, 1 << 24
"""Coordinates within 1e7 m lie in fewer than 2 ** 23 cells on each side of the origin."""


class TooLargeError(Exception):
    """A map covers more ground than can be looked through."""


def _ranges(counts: Index) -> tuple[Index, Index]:
    """Owner and place within it of ``counts[i]`` items of every owner ``i``."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)


def _cell(values_m: Array) -> Index:
    return np.floor(values_m / _CELL_M).astype(np.int64) + _OFFSET


def _key(town: Index, column: Index, row: Index) -> Index:
    return np.asarray((town * _SPAN + column) * _SPAN + row)


class Strips:
    """Segments of the centre lines of strips, found by place.

    Args:
        town: Town of each strip ``[strips]``, below 2 ** 15.
        lengths: Vertices of each strip, at least two ``[strips]``.
        x_m: Vertices of all strips, one strip after the other ``[vertices]``, within 1e7 m.
        y_m: The same, y.
        width_m: Full width at every vertex.
        slack_m: How far beyond its edges a strip is still looked for.

    Raises:
        TooLargeError: The strips cover too much ground.
    """

    def __init__(self, town: Index, lengths: Index, x_m: Array, y_m: Array, width_m: Array, *, slack_m: float) -> None:
        strip = np.repeat(np.arange(len(lengths)), lengths)
        first = np.flatnonzero(strip[1:] == strip[:-1])
        vertices = np.stack([x_m, y_m, width_m / 2], axis=1)
        self._starts, self._steps = vertices[first], vertices[first + 1] - vertices[first]
        self._strip = strip[first]
        is_new = np.diff(self._strip, prepend=-1) != 0
        self._begins, self._ends = is_new, np.append(is_new[1:], True)[: len(is_new)]
        self._square = (self._steps[:, :2] ** 2).sum(axis=1)
        self._cells, self._firsts, self._segments = self._filed(town[self._strip], slack_m)

    def _filed(self, town: Index, slack_m: float) -> tuple[Index, Index, Index]:
        """Occupied cells, ascending, the first entry of each and of the end, and the segment of every entry."""
        counts = np.maximum(np.ceil(np.sqrt(self._square) / _PIECE_M), 1)
        if counts.sum() > _MAX_ENTRIES:
            raise TooLargeError
        segment, place = _ranges(counts.astype(np.int64))
        share = (place / counts[segment])[:, None]
        low, step = self._starts[segment, :2], self._steps[segment, :2] / counts[segment][:, None]
        begin = low + share * self._steps[segment, :2]
        reach = np.maximum(self._starts[segment, 2], self._starts[segment, 2] + self._steps[segment, 2]) + slack_m
        least = _cell(np.minimum(begin, begin + step) - reach[:, None])
        spans = _cell(np.maximum(begin, begin + step) + reach[:, None]) - least + 1
        if spans.prod(axis=1, dtype=np.float64).sum() > _MAX_ENTRIES:
            raise TooLargeError
        piece, place = _ranges(spans.prod(axis=1))
        column = least[piece, 0] + place // spans[piece, 1]
        row = least[piece, 1] + place % spans[piece, 1]
        key = _key(town[segment[piece]], column, row)
        order = np.argsort(key, kind="stable")
        key = key[order]
        firsts = np.flatnonzero(np.diff(key, prepend=-1) != 0) if len(key) else np.zeros(0, np.int64)
        return key[firsts], np.append(firsts, len(key)), segment[piece][order]

    def near(self, town: Index, x_m: Array, y_m: Array) -> Iterator[tuple[Index, Index, Array, Mask]]:
        """Pairs of points and strips near them, in blocks; a pair may occur several times.

        Args:
            town: Town of each point ``[points]``.
            x_m: World frame, within 1e7 m.
            y_m: The same, y.

        Yields:
            Point, strip, excess in metres, and whether the nearest point of the centre line is one of its ends.
        """
        if not len(self._cells):
            return
        key = _key(town, _cell(x_m), _cell(y_m))
        place = np.minimum(np.searchsorted(self._cells, key), len(self._cells) - 1)
        counts = np.where(self._cells[place] == key, self._firsts[place + 1] - self._firsts[place], 0)
        blocks = np.maximum(np.arange(len(key)) // _BLOCK_ROWS, np.cumsum(counts) // _BLOCK_PAIRS)
        for rows in np.split(np.arange(len(key)), np.flatnonzero(np.diff(blocks)) + 1):
            owner, entry = _ranges(counts[rows])
            point = rows[owner]
            segment = self._segments[self._firsts[place[point]] + entry]
            yield (point, self._strip[segment], *self._excess(segment, x_m[point], y_m[point]))

    def _excess(self, segment: Index, x_m: Array, y_m: Array) -> tuple[Array, Mask]:
        x, y, half = self._starts[segment].T
        step_x, step_y, widens = self._steps[segment].T
        x, y = x_m - x, y_m - y
        share = np.clip((x * step_x + y * step_y) / self._square[segment], 0.0, 1.0)
        distance = np.hypot(x - share * step_x, y - share * step_y)
        is_end = (self._begins[segment] & (share == 0)) | (self._ends[segment] & (share == 1))
        return distance - (half + share * widens), is_end


@dataclass(frozen=True)
class Areas:
    """Areas inside closed outlines.

    Attributes:
        town: Town of each area ``[areas]``.
        outlines: Vertices ``[vertices, 2]`` of each area, world frame; the last one joins the first.
    """

    town: Index
    outlines: tuple[Array, ...]

    def near(self, town: Index, x_m: Array, y_m: Array, *, slack_m: float) -> Iterator[tuple[Index, Array]]:
        """Points near each area, with the excess over it: the distance to its outline, negative inside."""
        points = np.stack([x_m, y_m], axis=1)
        for own, outline in zip(self.town.tolist(), self.outlines, strict=True):
            low, high = outline.min(axis=0) - slack_m, outline.max(axis=0) + slack_m
            inside = ((points >= low) & (points <= high)).all(axis=1) & (town == own)
            rows = np.flatnonzero(inside)
            for part in np.array_split(rows, max(1, len(rows) * len(outline) // _BLOCK_PAIRS)):
                yield part, _outline_excess(outline, points[part])


def _outline_excess(outline: Array, points: Array) -> Array:
    step = np.roll(outline, -1, axis=0) - outline
    away = points[:, None] - outline  # [points, vertices, 2]
    square = (step**2).sum(axis=1)
    share = np.clip((away * step).sum(axis=2) / np.where(square > 0, square, 1.0), 0.0, 1.0)
    distance = np.hypot(*np.moveaxis(away - share[:, :, None] * step, 2, 0)).min(axis=1)
    above = away[:, :, 1] >= 0
    crosses = above != np.roll(above, -1, axis=1)
    left = step[:, 0] * away[:, :, 1] - step[:, 1] * away[:, :, 0] > 0
    odd = (crosses & (left == (step[:, 1] > 0))).sum(axis=1) % 2 == 1
    return np.asarray(np.where(odd, -distance, distance))
