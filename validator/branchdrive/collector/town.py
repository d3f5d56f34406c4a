"""The map of a town as a collector makes it, and what it says of the places of the ego.

Source: spec/05-raw-streams.md#map.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.contract.limits import spec_limits
from branchdrive.driving.route import project
from branchdrive.driving.surface import Areas, Work
from branchdrive.errors import UsageError

__all__ = ["Element", "Ground", "crossing_element", "lane_element", "sign_element", "stop_line_element", "under"]

Element = Mapping[str, Any]
"""Columns of one row of the table `map`, without the town."""

_SIGNS = ("signal", "stop_sign", "yield_sign")

_STRIPS = ("lane", "shoulder", "parking")

_FAR_M = 1e9
"""Lanes that do not hold a point come after all that do."""


@dataclass(frozen=True, eq=False)
class Ground:
    """What lies under points, each field ``[points]``.

    Attributes:
        lane_id: The lane that holds the point, that of the nearest centre line; ``None`` where none does.
        on_road: Whether a lane, shoulder, parking strip or road area holds it.
        speed_limit_mps: Limit of that lane or, beside the lanes, of the nearest one; ``None`` where it has none.
    """

    lane_id: list[str | None]
    on_road: NDArray[np.bool_]
    speed_limit_mps: list[float | None]


def lane_element(
    lane_id: str, x_m: ArrayLike, y_m: ArrayLike, width_m: float, speed_limit_mps: float | None = None
) -> dict[str, Any]:
    """A lane of constant width as an element of a map.

    Args:
        lane_id: Identity of the lane, and of the element.
        x_m: Vertices of the centre line in driving order, at least two.
        y_m: The same, y.
        width_m: Full width.
        speed_limit_mps: Speed limit; ``None`` where there is none or it is unknown.
    """
    x, y = (np.asarray(values, np.float64) for values in (x_m, y_m))
    element = {"element_id": lane_id, "kind": "lane", "lane_id": lane_id, "x_m": x, "y_m": y}
    return {**element, "width_m": np.full(len(x), float(width_m)), "speed_limit_mps": speed_limit_mps}


def sign_element(
    kind: Literal["signal", "stop_sign", "yield_sign"],
    element_id: str,
    x_m: float,
    y_m: float,
    lane_id: str | None = None,
) -> dict[str, Any]:
    """A signal or sign where it stands, as an element of a map.

    Args:
        kind: What it is; a town whose rollouts record traffic lights has a signal (BD-MAP-009).
        element_id: Identity of the element.
        x_m: Where it stands.
        y_m: The same, y.
        lane_id: The lane that it governs, where it governs one; `None` where that is unknown.

    Raises:
        UsageError: There is no such kind.
    """
    if kind not in _SIGNS:
        raise UsageError(f"{element_id}: there is no sign of kind {kind!r}; one of {', '.join(map(repr, _SIGNS))}")
    return {"element_id": element_id, "kind": kind, "lane_id": lane_id, **_vertices(element_id, [x_m], [y_m], 1)}


def stop_line_element(
    element_id: str,
    x_m: ArrayLike,
    y_m: ArrayLike,
    lane_id: str | None = None,
    marking: Literal["solid", "broken"] | None = None,
) -> dict[str, Any]:
    """A line across a lane, behind which vehicles wait, as an element of a map.

    Args:
        element_id: Identity of the element.
        x_m: Vertices from one side of the lane to the other, at least two.
        y_m: The same, y.
        lane_id: The lane that it crosses.
        marking: How it is painted; `None` where it is not, or unknown.

    Raises:
        UsageError: Vertices are too few, or x and y are not equally long.
    """
    element = {"element_id": element_id, "kind": "stop_line", "lane_id": lane_id, "marking": marking}
    return {**element, **_vertices(element_id, x_m, y_m, 2)}


def crossing_element(element_id: str, x_m: ArrayLike, y_m: ArrayLike) -> dict[str, Any]:
    """A pedestrian crossing as an element of a map.

    Args:
        element_id: Identity of the element.
        x_m: Vertices of the outline, at least three; the last one joins the first, and is not given twice.
        y_m: The same, y.

    Raises:
        UsageError: Vertices are too few, x and y are not equally long, or the last vertex is the first.
    """
    vertices = _vertices(element_id, x_m, y_m, 3)
    if all(values[0] == values[-1] for values in vertices.values()):
        raise UsageError(f"{element_id}: the last vertex of an outline joins the first; leave it out")
    return {"element_id": element_id, "kind": "crossing", **vertices}


def _vertices(element_id: str, x_m: ArrayLike, y_m: ArrayLike, least: int) -> dict[str, NDArray[np.float64]]:
    x, y = (np.asarray(values, np.float64) for values in (x_m, y_m))
    if x.ndim != 1 or x.shape != y.shape or len(x) < least:
        raise UsageError(
            f"{element_id}: expected x_m and y_m with as many vertices each, at least {least}; found shapes "
            f"{list(x.shape)} and {list(y.shape)}"
        )
    return {"x_m": x, "y_m": y}


def under(elements: Sequence[Element], x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> Ground:
    """What the map of a town says of points ``[points]``."""
    count = len(x_m)
    lane_id: list[str | None] = [None] * count
    limit: list[float | None] = [None] * count
    on_road, nearest = np.zeros(count, np.bool_), np.full(count, np.inf)
    for element in elements:
        if element["kind"] == "road_area":
            outline = np.stack([np.asarray(element[axis], np.float64) for axis in ("x_m", "y_m")], axis=1)
            for points, excess_m in Areas(np.zeros(1, np.int64), (outline,)).near(
                np.zeros(count, np.int64), x_m, y_m, Work(spec_limits().max_map_pairs), slack_m=0.0
            ):
                on_road[points[excess_m <= 0]] = True
        if element["kind"] not in _STRIPS:
            continue
        line_x, line_y, width_m = (np.asarray(element[name], np.float64) for name in ("x_m", "y_m", "width_m"))
        place = project(x_m, y_m, line_x, line_y)
        arc_m = np.concatenate([np.zeros(1), np.cumsum(np.hypot(np.diff(line_x), np.diff(line_y)))])
        away_m = np.abs(place.offset_m)
        holds = away_m <= np.interp(place.progress_m, arc_m, width_m) / 2
        on_road |= holds
        if element["kind"] == "lane":
            rank = np.where(holds, away_m, _FAR_M + away_m)
            for point in np.flatnonzero(rank < nearest).tolist():
                lane_id[point] = element["lane_id"] if holds[point] else None
                limit[point], nearest[point] = element.get("speed_limit_mps"), rank[point]
    return Ground(lane_id, on_road, limit)
