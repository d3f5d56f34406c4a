"""Elements of a map that reach far, cut down to what lies near a rectangle: drawing takes no points from far away."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from branchdrive.raw.town_map import AREAS, POINTS
from branchdrive_reference.geometry.polyline import Array, Polyline
from branchdrive_reference.town.elements import Element

__all__ = ["cropped"]

_CUT_M = 96.0
"""Lines are cut at multiples of this arc length: a whole number of dashes with their gaps, which so stay in place."""

_LEAST_M = 1e-6
"""Vertices of a cut line are no closer."""


def cropped(element: Element, low_m: Array, high_m: Array) -> Iterator[Element]:
    """What of an element lies in a rectangle; lines reach beyond it, and may come in several parts.

    Args:
        element: An element of a map.
        low_m: The corner of the rectangle with the least coordinates, world frame ``[2]``.
        high_m: The opposite corner ``[2]``.
    """
    if element["kind"] in POINTS:
        yield element
    elif element["kind"] in AREAS:
        outline = _within(np.stack([element["x_m"], element["y_m"]], axis=1), low_m, high_m)
        if len(outline) > 2:
            yield element | {"x_m": outline[:, 0], "y_m": outline[:, 1]}
    else:
        line = Polyline(element["x_m"], element["y_m"])
        for begin_m, end_m in _stretches(line, low_m, high_m):
            inner_m = line.arc_m[(line.arc_m > begin_m) & (line.arc_m < end_m)]
            cuts = np.unique(np.concatenate([np.arange(begin_m, end_m, _CUT_M), inner_m, [end_m]]))
            cuts = cuts[np.diff(cuts, prepend=-np.inf) > _LEAST_M]
            if len(cuts) > 1:
                x_m, y_m = line.at(cuts)
                width_m = element.get("width_m")
                widths = {} if width_m is None else {"width_m": np.interp(cuts, line.arc_m, width_m)}
                yield element | {"x_m": x_m, "y_m": y_m} | widths


def _stretches(line: Polyline, low_m: Array, high_m: Array) -> Iterator[tuple[float, float]]:
    """Arc lengths between which a line is near a rectangle, by the clipping of Liang and Barsky."""
    points = np.stack([line.x_m, line.y_m], axis=1)
    steps = np.diff(points, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = (low_m - points[:-1]) / steps, (high_m - points[:-1]) / steps
    first = np.maximum(np.minimum(low, high).max(axis=1), 0.0)
    last = np.minimum(np.maximum(low, high).min(axis=1), 1.0)
    meets = first <= last
    lengths_m = np.diff(line.arc_m)[meets]
    begins = np.floor((line.arc_m[:-1][meets] + first[meets] * lengths_m) / _CUT_M) * _CUT_M
    ends = np.ceil((line.arc_m[:-1][meets] + last[meets] * lengths_m) / _CUT_M) * _CUT_M
    ends = np.minimum(ends, line.length_m)
    if len(begins):
        is_apart = begins[1:] > ends[:-1]
        yield from zip(
            begins[np.append(True, is_apart)].tolist(), ends[np.append(is_apart, True)].tolist(), strict=True
        )


def _within(outline_m: Array, low_m: Array, high_m: Array) -> Array:
    """The part of an outline ``[corners, 2]`` in a rectangle, by the clipping of Sutherland and Hodgman."""
    for axis, bound_m, sign in ((0, low_m[0], 1), (1, low_m[1], 1), (0, high_m[0], -1), (1, high_m[1], -1)):
        beyond_m = sign * (outline_m[:, axis] - bound_m)
        after_m = np.roll(beyond_m, -1)
        crosses = (beyond_m >= 0) != (after_m >= 0)
        share = np.divide(beyond_m, beyond_m - after_m, out=np.zeros_like(beyond_m), where=crosses)
        meetings = outline_m + share[:, None] * (np.roll(outline_m, -1, axis=0) - outline_m)
        both = np.stack([outline_m, meetings], axis=1).reshape(-1, 2)
        outline_m = both[np.stack([beyond_m >= 0, crosses], axis=1).ravel()]
    return outline_m
