"""The map layer: paved areas, carriageways, junction areas and lane markings around the branch.

The map of a recorded town, if the reference package has that town.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from numpy.typing import NDArray

from branchdrive_reference.drawing.palette import BACKDROP, Rgb
from branchdrive_reference.drawing.view import Layer, View
from branchdrive_reference.geometry.polyline import Polyline
from branchdrive_reference.town.lane import Lane, LaneSide, RoadClass, Turn
from branchdrive_reference.town.network import RoadNetwork
from branchdrive_reference.town.town import TOWN_NAMES, town

__all__ = ["draw_roads", "lanes_in_view", "town_map"]

Points = NDArray[np.float64]
"""Points of the view frame ``[points, 2]``."""

_BESIDE_M = 0.6
"""An edge this far inside another lane, or closer to it, is no edge of the road."""

_DASHES = (0.0, (6.0, 6.0))
_MARGIN_M = 25.0


def lanes_in_view(network: RoadNetwork, view: View) -> list[Lane]:
    """Lanes and connectors that may be seen, in declared order."""
    return [
        lane for lane in network.lanes.values() if view.sees(*view.place(lane.centre.x_m, lane.centre.y_m), _MARGIN_M)
    ]


def _place(line: Polyline, view: View) -> Points:
    return np.stack(view.place(line.x_m, line.y_m), axis=1)


def _strip(lane: Lane, view: View, left_m: float, right_m: float) -> Points:
    """Outline of the part of a lane between two offsets to the left and right of its centre line."""
    left, right = (_place(lane.centre.shifted(offset), view) for offset in (left_m, -right_m))
    return np.concatenate([left, right[::-1]])


def draw_roads(axes: Axes, network: RoadNetwork, view: View) -> None:
    """Draw the town below everything else."""
    lanes = lanes_in_view(network, view)
    roads = [lane for lane in lanes if lane.turn is Turn.FOLLOW]
    outer = [lane for lane in roads if lane.right is not LaneSide.SAME_DIRECTION]
    paved = [_strip(lane, view, lane.width_m / 2, lane.right_edge_m) for lane in outer]
    paved += [_disc(network, name, view) for name in {lane.junction: None for lane in lanes if lane.junction}]
    parking = [
        _strip(lane, view, -lane.width_m / 2, lane.right_edge_m) for lane in roads if lane.right is LaneSide.PARKING
    ]
    carriageways = [_strip(lane, view, lane.width_m / 2, lane.width_m / 2) for lane in roads]
    crossings = [_sweep(network, lane, view) for lane in lanes if lane.turn is not Turn.FOLLOW]
    _fill(axes, paved, Layer.GROUND, BACKDROP["kerb"], edge_pt=1.6)
    _fill(axes, paved, Layer.PAVED, BACKDROP["paved"], edge_pt=0.0)
    _fill(axes, parking, Layer.PAVED, BACKDROP["parking"], edge_pt=0.0)
    _fill(axes, [*carriageways, *(part for parts in crossings for part in parts)], Layer.CARRIAGEWAY,
          BACKDROP["carriageway"], edge_pt=0.6)  # fmt: skip
    _draw_markings(axes, roads, view)


def _fill(axes: Axes, outlines: Sequence[Points], layer: Layer, colour: Rgb, *, edge_pt: float) -> None:
    edge = colour if edge_pt else "none"
    axes.add_collection(
        PolyCollection(list(outlines), facecolors=[colour], edgecolors=edge, linewidths=edge_pt, zorder=layer),
        autolim=False,
    )


def _disc(network: RoadNetwork, name: str, view: View) -> Points:
    """Outline of a junction's paved disc."""
    junction = network.junctions[name]
    turn = np.linspace(0.0, 2 * np.pi, 73)
    x, y = junction.x_m + junction.radius_m * np.cos(turn), junction.y_m + junction.radius_m * np.sin(turn)
    return np.stack(view.place(x, y), axis=1)


def _sweep(network: RoadNetwork, connector: Lane, view: View) -> list[Points]:
    """What a connector covers, and what lies between it and the centre of its junction."""
    junction = network.junctions[connector.junction]
    centre = np.stack(view.place(np.array([junction.x_m]), np.array([junction.y_m])), axis=1)
    half_m = connector.width_m / 2
    edges = [_place(connector.centre.shifted(offset), view) for offset in (half_m, -half_m)]
    return [_strip(connector, view, half_m, half_m), *(np.concatenate([centre, edge]) for edge in edges)]


def _draw_markings(axes: Axes, roads: Sequence[Lane], view: View) -> None:
    solid: list[Points] = []
    dashed: list[Points] = []
    for lane in roads:
        for side, left_m in ((lane.left, lane.width_m / 2), (lane.right, -lane.width_m / 2)):
            line = lane.centre.shifted(left_m)
            if side is LaneSide.SAME_DIRECTION:
                dashed += [_place(line, view)] if left_m > 0 else []
            elif side is LaneSide.ONCOMING:
                solid += [_place(lane.centre.shifted(left_m - 0.1), view)]
            else:
                inside = _is_inside_another(line, lane, roads)
                points = _place(line, view)
                solid += _runs(points, ~inside)
                dashed += _runs(points, inside) if lane.road_class is not RoadClass.RAMP else []
    white = BACKDROP["marking"]
    for lines, style in ((solid, "solid"), (dashed, _DASHES)):
        axes.add_collection(
            LineCollection(lines, colors=[white], linewidths=1.1, linestyles=[style], zorder=Layer.MARKING),
            autolim=False,
        )


def _is_inside_another(line: Polyline, lane: Lane, roads: Iterable[Lane]) -> NDArray[np.bool_]:
    """Where a lane's edge runs along or inside a ramp, or a ramp's edge inside another lane, ``[vertices]``."""
    inside = np.zeros(len(line.x_m), np.bool_)
    for other in roads:
        is_ramp = RoadClass.RAMP in (other.road_class, lane.road_class)
        if other is lane or not is_ramp or set(other.way) <= set(lane.way):
            continue
        distance = np.hypot(
            line.x_m[:, None] - other.centre.x_m[None, :], line.y_m[:, None] - other.centre.y_m[None, :]
        ).min(axis=1)
        inside |= distance < other.width_m / 2 + _BESIDE_M
    return inside


def _runs(points: Points, chosen: NDArray[np.bool_]) -> list[Points]:
    """Stretches of at least two chosen neighbours."""
    cuts = np.flatnonzero(np.diff(chosen.astype(np.int8))) + 1
    parts = zip(np.split(points, cuts), np.split(chosen, cuts), strict=True)
    return [part for part, is_chosen in parts if is_chosen[0] and len(part) > 1]


def town_map(name: str) -> RoadNetwork | None:
    """The network of the town with this recorded name; ``None`` where the reference package has none."""
    return town(name) if name in TOWN_NAMES else None
