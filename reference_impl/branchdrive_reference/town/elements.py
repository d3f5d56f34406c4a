"""A town as the elements of its map: lanes and strips beside them, junctions, markings, lines, signals and signs.

Source: spec/05-raw-streams.md#map.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive_reference.geometry.polyline import Array, Polyline
from branchdrive_reference.town.crossroads import Control, Crossroads
from branchdrive_reference.town.lane import LANE_WIDTH_M, Lane, LaneSide, RoadClass, Turn
from branchdrive_reference.town.network import RoadNetwork

__all__ = ["Element", "town_elements"]

Element = dict[str, Any]
"""Columns of one row of the table `map`, without the town."""

_TOLERANCE_M = 0.01
_BORDER_TOLERANCE_M = 0.04
"""Vertices that lie this close to the line without them are left out; nothing recomputes from borders."""

_GRID_PER_M = 1024.0
"""Vertices lie on a grid of about a millimetre: the lower half of their bytes is zero and takes no room."""

_DISC_VERTICES = 72
"""The disc of 20 m radius leaves its outline by 2 cm."""

_BESIDE_M = 0.6
"""An edge this far inside another lane, or closer to it, is no edge of the road."""

_POST_M = 1.2
"""How far outside the paved road a signal or sign stands."""

_LINE_GAP_M = 0.2
"""A line across a lane ends this far from the lane's edges."""

_SIGNS = {Control.SIGNAL: "signal", Control.STOP: "stop_sign", Control.YIELD: "yield_sign"}


@lru_cache(maxsize=4)
def town_elements(network: RoadNetwork) -> tuple[Element, ...]:
    """Elements of the map of a town, made once per process."""
    lanes = tuple(network.lanes.values())
    roads = [lane for lane in lanes if lane.turn is Turn.FOLLOW]
    return (
        *(_strip(lane.lane_id, "lane", lane, lane.centre, lane.width_m) for lane in lanes),
        *(element for lane in roads for element in _beside(lane)),
        *(_disc(name, junction) for name, junction in network.junctions.items()),
        *(element for lane in roads for element in _borders(lane, roads)),
        *(element for lane in roads if lane.junction for element in _control(lane, network.junctions[lane.junction])),
    )


def _element(element_id: str, kind: str, lane: Lane | None, line: Polyline, **columns: object) -> Element:
    return {
        "element_id": element_id,
        "kind": kind,
        "lane_id": lane.lane_id if lane else None,
        "x_m": _on_grid(line.x_m),
        "y_m": _on_grid(line.y_m),
        **columns,
    }


def _on_grid(values_m: Array) -> Array:
    return np.asarray(np.round(values_m * _GRID_PER_M) / _GRID_PER_M)


def _strip(element_id: str, kind: str, lane: Lane, middle: Polyline, width_m: float) -> Element:
    line = middle.simplified(_TOLERANCE_M)
    limit = {"speed_limit_mps": lane.speed_limit_mps} if kind == "lane" else {}
    return _element(element_id, kind, lane, line, width_m=np.full(len(line.x_m), width_m), **limit)


def _beside(lane: Lane) -> Iterator[Element]:
    """The paved strip to the right of a road's outermost lane."""
    half_m = lane.width_m / 2
    if lane.right is LaneSide.SAME_DIRECTION or lane.right_edge_m <= half_m:
        return
    kind = "parking" if lane.right is LaneSide.PARKING else "shoulder"
    middle = lane.centre.shifted(-(half_m + lane.right_edge_m) / 2)
    yield _strip(f"{lane.lane_id}/{kind}", kind, lane, middle, lane.right_edge_m - half_m)


def _disc(name: str, junction: Crossroads) -> Element:
    turn = np.arange(_DISC_VERTICES) * (2 * np.pi / _DISC_VERTICES)
    x, y = junction.x_m + junction.radius_m * np.cos(turn), junction.y_m + junction.radius_m * np.sin(turn)
    return _element(f"{name}/junction", "road_area", None, Polyline(x, y))


def _borders(lane: Lane, roads: Sequence[Lane]) -> Iterator[Element]:
    """Markings along both edges of a lane; what two lanes share belongs to the right one."""
    for side, edge_m, name in ((lane.left, lane.width_m / 2, "left"), (lane.right, -lane.width_m / 2, "right")):
        runs: list[tuple[Polyline, str]] = []
        line = lane.centre.shifted(edge_m)
        if side is LaneSide.SAME_DIRECTION:
            runs = [(line, "broken")] if edge_m > 0 else []
        elif side is LaneSide.ONCOMING:
            runs = [(lane.centre.shifted(edge_m - 0.1), "solid")]
        else:
            inside = _is_inside_another(line, lane, roads)
            runs = [(part, "solid") for part in _runs(line, ~inside)]
            runs += [(part, "broken") for part in _runs(line, inside) if lane.road_class is not RoadClass.RAMP]
        for number, (part, marking) in enumerate(runs):
            yield _element(
                f"{lane.lane_id}/{name}{number}",
                "lane_border",
                lane,
                part.simplified(_BORDER_TOLERANCE_M),
                marking=marking,
            )


def _is_inside_another(line: Polyline, lane: Lane, roads: Iterable[Lane]) -> NDArray[np.bool_]:
    """Where a lane's edge runs along or inside a ramp, or a ramp's edge inside another lane, ``[vertices]``."""
    inside = np.zeros(len(line.x_m), np.bool_)
    for other in roads:
        is_ramp = RoadClass.RAMP in (other.road_class, lane.road_class)
        if other is lane or not is_ramp or set(other.way) <= set(lane.way):
            continue
        near, its = np.flatnonzero(_is_around(line, other.centre)), _is_around(other.centre, line)
        if len(near) and its.any():
            x, y = other.centre.x_m[its], other.centre.y_m[its]
            distance = np.hypot(line.x_m[near, None] - x, line.y_m[near, None] - y).min(axis=1)
            inside[near] |= distance < other.width_m / 2 + _BESIDE_M
    return inside


def _is_around(line: Polyline, other: Polyline) -> NDArray[np.bool_]:
    """Vertices of a line in the box around another one, a lane's width beyond it included ``[vertices]``."""
    (left, right), (low, high) = ((v.min() - LANE_WIDTH_M, v.max() + LANE_WIDTH_M) for v in (other.x_m, other.y_m))
    return np.asarray((line.x_m > left) & (line.x_m < right) & (line.y_m > low) & (line.y_m < high))


def _runs(line: Polyline, chosen: NDArray[np.bool_]) -> list[Polyline]:
    """Stretches of at least two chosen neighbours."""
    cuts = np.flatnonzero(np.diff(chosen.astype(np.int8))) + 1
    parts = zip(*(np.split(values, cuts) for values in (line.x_m, line.y_m, chosen)), strict=True)
    return [Polyline(x, y) for x, y, is_chosen in parts if is_chosen[0] and len(x) > 1]


def _control(lane: Lane, junction: Crossroads) -> Iterator[Element]:
    """Line and post at the end of a lane that leads to a junction, where its traffic has to wait for others.

    The lanes of an approach share the place of the post, outside of the outermost.
    """
    if junction.control is not Control.SIGNAL and lane.way[0] in junction.major:
        return
    half_m = lane.width_m / 2 - _LINE_GAP_M
    ends = [lane.centre.shifted(side_m) for side_m in (half_m, -half_m)]
    line = Polyline(*(np.array([getattr(end, axis)[-1] for end in ends]) for axis in ("x_m", "y_m")))
    marking = "broken" if junction.control is Control.YIELD else "solid"
    yield _element(f"{lane.lane_id}/line", "stop_line", lane, line, marking=marking)
    beside = lane.centre.shifted(-lane.right_edge_m - _POST_M)
    post = Polyline(beside.x_m[-1:], beside.y_m[-1:])
    yield _element(f"{lane.lane_id}/post", _SIGNS[junction.control], lane, post)
