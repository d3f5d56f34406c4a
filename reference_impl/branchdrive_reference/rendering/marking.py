"""Painted lines as short pieces, so that they can be drawn at the resolution of an image and never vanish."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from branchdrive_reference.geometry.polyline import Array, Polyline
from branchdrive_reference.town.elements import Element

__all__ = ["Pieces", "kerb_pieces", "painted_pieces", "zebra_pieces"]

LINE_WIDTH_M, STOP_LINE_WIDTH_M = 0.16, 0.45
"""Widths of the lines between lanes and of those at which vehicles wait."""

_DASH_M, _DASH_GAP_M = 3.0, 5.0
_TEETH_M, _TEETH_GAP_M = 0.5, 0.35
"""Dashes of a lane border, and of a line at which vehicles give way."""

_LONGEST_M = 6.0
"""A piece is nearly straight and lies wholly before a camera or wholly behind it."""

_STRIPE_M = 0.5
"""Width of the stripes of a crossing, and of the gaps between them."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """Straight pieces of lines on the ground, world frame, metres.

    Attributes:
        start_m: Their beginnings ``[pieces, 2]``.
        end_m: Their ends ``[pieces, 2]``.
        width_m: Their widths ``[pieces]``.
    """

    start_m: Array
    end_m: Array
    width_m: Array

    @classmethod
    def joined(cls, parts: Iterable[Pieces]) -> Pieces:
        """All pieces of some."""
        found = list(parts)
        if not found:
            return cls(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
        return cls(*(np.concatenate([getattr(one, name) for one in found]) for name in ("start_m", "end_m", "width_m")))

    def chosen(self, which: NDArray[np.bool_]) -> Pieces:
        """Some of the pieces."""
        return Pieces(self.start_m[which], self.end_m[which], self.width_m[which])

    def corners(self) -> Array:
        """Their outlines ``[pieces, 4, 2]``."""
        along = self.end_m - self.start_m
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        across *= (self.width_m / 2 / np.maximum(np.hypot(*along.T), 1e-9))[:, None]
        sides = (self.start_m + across, self.end_m + across, self.end_m - across, self.start_m - across)
        return np.stack(sides, axis=1)

    def __len__(self) -> int:
        return len(self.width_m)


def painted_pieces(element: Element) -> Pieces:
    """Pieces of a painted lane border or stop line; none without paint."""
    if element.get("marking") is None or element["kind"] not in ("lane_border", "stop_line"):
        return Pieces.joined([])
    is_stop = element["kind"] == "stop_line"
    dash = (_TEETH_M, _TEETH_GAP_M) if is_stop else (_DASH_M, _DASH_GAP_M)
    width_m = STOP_LINE_WIDTH_M if is_stop else LINE_WIDTH_M
    line = Polyline(element["x_m"], element["y_m"])
    return _solid(line, width_m) if element["marking"] == "solid" else _broken(line, width_m, *dash)


def kerb_pieces(element: Element, width_m: float) -> Pieces:
    """Pieces of a line that is there for its whole length."""
    return _solid(Polyline(element["x_m"], element["y_m"]), width_m)


def _solid(line: Polyline, width_m: float) -> Pieces:
    count = max(1, int(np.ceil(line.length_m / _LONGEST_M)))
    cuts = np.unique(np.concatenate([line.arc_m, np.linspace(0.0, line.length_m, count + 1)]))
    points = np.stack(line.at(cuts), axis=1)
    return Pieces(points[:-1], points[1:], np.full(len(points) - 1, width_m))


def _broken(line: Polyline, width_m: float, dash_m: float, gap_m: float) -> Pieces:
    start = np.arange(0.0, line.length_m, dash_m + gap_m)
    end = np.minimum(start + dash_m, line.length_m)
    begins, ends = (np.stack(line.at(cuts), axis=1) for cuts in (start, end))
    return Pieces(begins, ends, np.full(len(start), width_m))


def zebra_pieces(element: Element) -> Pieces:
    """Stripes of a pedestrian crossing: across its longer extent, as far as the rectangle around it reaches."""
    outline = np.stack([element["x_m"], element["y_m"]], axis=1)
    middle = outline.mean(axis=0)
    axes = np.linalg.svd(outline - middle, full_matrices=False)[2]
    (low_u, low_v), (high_u, high_v) = (end(((outline - middle) @ axes.T), axis=0) for end in (np.min, np.max))
    centres = np.arange(low_u + _STRIPE_M, high_u, 2 * _STRIPE_M)
    ends: Sequence[Array] = [
        middle + np.stack([centres, np.full(len(centres), v)], axis=1) @ axes for v in (low_v, high_v)
    ]
    return Pieces(ends[0], ends[1], np.full(len(centres), _STRIPE_M))
