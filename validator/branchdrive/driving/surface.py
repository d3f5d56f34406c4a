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

__all__ = ["BLOCK_PAIRS", "CELL_M", "Areas", "Strips", "TooLargeError", "Work", "cell_key", "cell_of", "places_in"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

CELL_M = 4.0
_HALF_DIAGONAL_M = 0.7072 * CELL_M
_PIECE_M = 8.0
"""Segments are filed piece by piece, or a long oblique one would be filed all over its bounding box."""

_BLOCK_ROWS = 65_536
BLOCK_PAIRS = 1 << 17
_OFFSET, _SPAN = 1 << 23, 1 << 24
"""Coordinates within 1e7 m lie in fewer than 2 ** 23 cells on each side of the origin."""


class TooLargeError(Exception):
    """A map covers more ground, or more of it lies around places, than can be looked through; the text says so."""


class Work:
    """Pairs of a place and what lies near it that may still be compared.

    Args:
        num_pairs: How many of them.
    """

    def __init__(self, num_pairs: int) -> None:
        self._num_pairs = self._left = num_pairs

    def spend(self, num_pairs: int) -> None:
        """Note pairs that are about to be compared.

        Raises:
            TooLargeError: They are more than are left.
        """
        self._left -= num_pairs
        if self._left < 0:
            raise TooLargeError(f"takes more than {self._num_pairs:,} pairs of a place and what lies near it")


def places_in(counts: Index) -> tuple[Index, Index]:
    """Owner and place within it of ``counts[i]`` items of every owner ``i``."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)


def cell_of(values_m: Array, cell_m: float = CELL_M) -> Index:
    """Column or row of the cells of a size, at least `CELL_M`, in which coordinates lie."""
    return np.floor(values_m / cell_m).astype(np.int64) + _OFFSET


def cell_key(town: Index, column: Index, row: Index) -> Index:
    """One number for each cell of each town."""
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
        most_squares: Cells that pieces may be filed in, together.

    Raises:
        TooLargeError: The strips cover too much ground.
    """

    def __init__(
        self, town: Index, lengths: Index, x_m: Array, y_m: Array, width_m: Array, *, slack_m: float, most_squares: int
    ) -> None:
        strip = np.repeat(np.arange(len(lengths)), lengths)
        first = np.flatnonzero(strip[1:] == strip[:-1])
        self._x, self._y, self._half = x_m[first], y_m[first], width_m[first] / 2
        self._step_x, self._step_y = x_m[first + 1] - self._x, y_m[first + 1] - self._y
        self._widens = width_m[first + 1] / 2 - self._half
        self._strip = strip[first]
        is_new = np.diff(self._strip, prepend=-1) != 0
        self._begins, self._ends = is_new, np.append(is_new[1:], True)[: len(is_new)]
        self._square = self._step_x**2 + self._step_y**2
        self._cells, self._firsts, self._segments = self._filed(town[self._strip], slack_m, most_squares)

    def _filed(self, town: Index, slack_m: float, most_squares: int) -> tuple[Index, Index, Index]:
        """Occupied cells, ascending, the first entry of each and of the end, and the segment of every entry."""
        counts = np.maximum(np.ceil(np.sqrt(self._square) / _PIECE_M), 1)
        too_large = TooLargeError(f"covers more than {most_squares:,} squares of {CELL_M:g} m")
        if counts.sum() > most_squares:
            raise too_large
        segment, place = places_in(counts.astype(np.int64))
        reach = np.maximum(self._half, self._half + self._widens) + slack_m
        lines = ((self._x, self._step_x), (self._y, self._step_y))
        low, high = (
            np.stack([start[segment] + (place + end) / counts[segment] * step[segment] for start, step in lines])
            for end in (0, 1)
        )
        least = cell_of(np.minimum(low, high) - reach[segment])
        spans = cell_of(np.maximum(low, high) + reach[segment]) - least + 1
        if spans.prod(axis=0, dtype=np.float64).sum() > most_squares:
            raise too_large
        piece, place = places_in(spans.prod(axis=0))
        column = least[0, piece] + place // spans[1, piece]
        row = least[1, piece] + place % spans[1, piece]
        segment = segment[piece]
        middle_x, middle_y = ((place - _OFFSET + 0.5) * CELL_M for place in (column, row))
        near = np.flatnonzero(self._foot(segment, middle_x, middle_y)[0] <= reach[segment] + _HALF_DIAGONAL_M)
        key, segment = cell_key(town[segment], column, row)[near], segment[near]
        order = np.argsort(key, kind="stable")  # segments ascend already
        key, segment = key[order], segment[order]
        is_new = np.append(True, (np.diff(key) != 0) | (np.diff(segment) != 0))[: len(key)]  # pieces of one segment
        key, segment = key[is_new], segment[is_new]
        firsts = np.flatnonzero(np.append(True, np.diff(key) != 0)[: len(key)])
        return key[firsts], np.append(firsts, len(key)), segment

    def near(
        self, town: Index, x_m: Array, y_m: Array, work: Work, labels: tuple[Index, Index] | None = None
    ) -> Iterator[tuple[Index, Index, Array, Mask]]:
        """Pairs of points and strips near them, in blocks; a pair may occur several times.

        Args:
            town: Town of each point ``[points]``.
            x_m: World frame, within 1e7 m.
            y_m: The same, y.
            work: Pairs of points and segments that may be compared.
            labels: A label of each strip and of each point, where only pairs of equal labels are asked for.

        Yields:
            Point, strip, excess in metres, and whether the nearest point of the centre line is one of its ends.

        Raises:
            TooLargeError: There are more pairs.
        """
        for point, segment in self._pairs(town, x_m, y_m, work):
            if labels is not None:
                same = np.flatnonzero(labels[0][self._strip[segment]] == labels[1][point])
                point, segment = point[same], segment[same]
            yield (point, self._strip[segment], *self._excess(segment, x_m[point], y_m[point]))

    def along(
        self, town: Index, x_m: Array, y_m: Array, work: Work
    ) -> Iterator[tuple[Index, Index, Array, Mask, Array]]:
        """The same as `near` with the heading of the strip there, in radians."""
        for point, segment in self._pairs(town, x_m, y_m, work):
            heading_rad = np.arctan2(self._step_y[segment], self._step_x[segment])
            yield (point, self._strip[segment], *self._excess(segment, x_m[point], y_m[point]), heading_rad)

    def _pairs(self, town: Index, x_m: Array, y_m: Array, work: Work) -> Iterator[tuple[Index, Index]]:
        """Points and the segments near them, in blocks."""
        if not len(self._cells) or not len(town):
            return
        key = cell_key(town, cell_of(x_m), cell_of(y_m))
        place = np.minimum(np.searchsorted(self._cells, key), len(self._cells) - 1)
        counts = np.where(self._cells[place] == key, self._firsts[place + 1] - self._firsts[place], 0)
        work.spend(int(counts.sum()))
        blocks = np.maximum(np.arange(len(key)) // _BLOCK_ROWS, np.cumsum(counts) // BLOCK_PAIRS)
        firsts = np.flatnonzero(np.diff(blocks, prepend=-1))
        for first, stop in zip(firsts, np.append(firsts[1:], len(key)), strict=True):
            owner, entry = places_in(counts[first:stop])
            point = owner + first
            yield point, self._segments[self._firsts[place[point]] + entry]

    def _excess(self, segment: Index, x_m: Array, y_m: Array) -> tuple[Array, Mask]:
        distance_m, share = self._foot(segment, x_m, y_m)
        half_m = self._half[segment] + share * self._widens[segment]
        is_end = (self._begins[segment] & (share == 0)) | (self._ends[segment] & (share == 1))
        return distance_m - half_m, is_end

    def _foot(self, segment: Index, x_m: Array, y_m: Array) -> tuple[Array, Array]:
        """Distance from each point to a segment, and the share of the segment at which its nearest point lies."""
        x, y = x_m - self._x[segment], y_m - self._y[segment]
        step_x, step_y = self._step_x[segment], self._step_y[segment]
        share = np.clip((x * step_x + y * step_y) / self._square[segment], 0.0, 1.0)
        x -= share * step_x
        y -= share * step_y
        return np.sqrt(x * x + y * y), share


@dataclass(frozen=True)
class Areas:
    """Areas inside closed outlines.

    Attributes:
        town: Town of each area ``[areas]``.
        outlines: Vertices ``[vertices, 2]`` of each area, world frame; the last one joins the first.
    """

    town: Index
    outlines: tuple[Array, ...]

    def near(self, town: Index, x_m: Array, y_m: Array, work: Work, *, slack_m: float) -> Iterator[tuple[Index, Array]]:
        """Points near each area, with the excess over it: the distance to its outline, negative inside.

        Raises:
            TooLargeError: There are more pairs of points and vertices, or of points and areas at one x, than may be.
        """
        points, order = np.stack([x_m, y_m], axis=1), np.argsort(x_m)
        for own, outline in zip(self.town.tolist(), self.outlines, strict=True):
            (low_x, low_y), (high_x, high_y) = outline.min(axis=0) - slack_m, outline.max(axis=0) + slack_m
            start, stop = np.searchsorted(x_m, low_x, "left", order), np.searchsorted(x_m, high_x, "right", order)
            work.spend(int(stop - start))
            rows = order[start:stop]
            rows = rows[(y_m[rows] >= low_y) & (y_m[rows] <= high_y) & (town[rows] == own)]
            work.spend(len(rows) * len(outline))
            if len(rows):
                for part in np.array_split(rows, max(1, len(rows) * len(outline) // BLOCK_PAIRS)):
                    yield part, _outline_excess(outline, points[part])


def _outline_excess(outline: Array, points: Array) -> Array:
    step_x, step_y = (np.roll(outline, -1, axis=0) - outline).T
    away_x, away_y = (points[:, axis, None] - outline[:, axis] for axis in (0, 1))  # [points, vertices]
    square = step_x * step_x + step_y * step_y
    share = np.clip((away_x * step_x + away_y * step_y) / np.where(square > 0, square, 1.0), 0.0, 1.0)
    distance = np.hypot(away_x - share * step_x, away_y - share * step_y).min(axis=1)
    above = away_y >= 0
    crosses = above != np.roll(above, -1, axis=1)
    left = step_x * away_y - step_y * away_x > 0
    odd = np.bitwise_xor.reduce(crosses & (left == (step_y > 0)), axis=1)
    return np.asarray(np.where(odd, -distance, distance))
