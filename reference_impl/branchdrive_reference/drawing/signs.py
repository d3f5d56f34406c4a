"""Stop lines, give-way lines and signals at the ends of the lanes that lead to junctions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from branchdrive_reference.drawing.layer import Layer
from branchdrive_reference.drawing.palette import BACKDROP, Rgb
from branchdrive_reference.drawing.roads import lanes_in_view
from branchdrive_reference.drawing.scene import Scene
from branchdrive_reference.drawing.view import View
from branchdrive_reference.geometry.polyline import Polyline
from branchdrive_reference.town.crossroads import Control
from branchdrive_reference.town.lane import Lane, LaneSide, Turn
from branchdrive_reference.town.network import RoadNetwork

__all__ = ["POSTS", "POST_SIZE", "draw_signs"]

_RED: Rgb = (0.84, 0.13, 0.16)
_LIGHTS: dict[str | None, Rgb] = {
    "green": (0.10, 0.62, 0.32),
    "yellow": (0.95, 0.72, 0.05),
    "red": _RED,
    None: BACKDROP["quiet"],
}
POSTS: Mapping[Control, Mapping[str, Any]] = {
    Control.SIGNAL: {"marker": "o", "color": _LIGHTS[None], "markeredgecolor": BACKDROP["ink"]},
    Control.STOP: {"marker": "8", "color": _RED, "markeredgecolor": BACKDROP["marking"]},
    Control.YIELD: {"marker": "v", "color": BACKDROP["marking"], "markeredgecolor": _RED},
}
"""How the post beside an approach is drawn; all share the size of `POST_SIZE`."""

POST_SIZE: Mapping[str, Any] = {"markersize": 7.5, "markeredgewidth": 1.1, "linestyle": "none"}
_BESIDE_M = 1.2
"""How far outside the paved road a signal or sign stands."""


def draw_signs(axes: Axes, network: RoadNetwork, view: View, scene: Scene) -> frozenset[Control]:
    """Draw what orders the traffic of every junction in view; the ego's light has its colour at the branch.

    Returns:
        The kinds of control that were drawn.
    """
    ego_lane = network.lanes.get(scene.lane_id or "")
    drawn = set()
    for lane in lanes_in_view(network, view):
        if lane.turn is not Turn.FOLLOW or not lane.junction:
            continue
        junction = network.junctions[lane.junction]
        if junction.control is not Control.SIGNAL and lane.way[0] in junction.major:
            continue
        _draw_line(axes, lane, view, is_solid=junction.control is not Control.YIELD)
        is_ego_s = ego_lane is not None and ego_lane.way == lane.way
        post = dict(POSTS[junction.control])
        if junction.control is Control.SIGNAL and is_ego_s:
            post["color"] = _LIGHTS.get(scene.traffic_light, _LIGHTS[None])
        if _draw_post(axes, lane, view, post):
            drawn.add(junction.control)
    return frozenset(drawn)


def _draw_line(axes: Axes, lane: Lane, view: View, *, is_solid: bool) -> None:
    """A line across the end of a lane."""
    x, y = zip(*((side.x_m[-1], side.y_m[-1]) for side in _edges(lane)), strict=True)
    u, v = view.place(np.array(x), np.array(y))
    style = "solid" if is_solid else (0.0, (1.2, 1.0))
    axes.plot(u, v, color=BACKDROP["marking"], linewidth=2.6, linestyle=style, solid_capstyle="butt",
              dash_capstyle="butt", zorder=Layer.MARKING)  # fmt: skip


def _draw_post(axes: Axes, lane: Lane, view: View, post: Mapping[str, Any]) -> bool:
    """A signal or sign to the right of the road's outermost lane; whether it is in view."""
    if lane.right is LaneSide.SAME_DIRECTION:
        return False
    beside = lane.centre.shifted(-lane.right_edge_m - _BESIDE_M)
    u, v = view.place(beside.x_m[-1:], beside.y_m[-1:])
    axes.plot(u, v, zorder=Layer.ACTOR, **post, **POST_SIZE)
    return view.sees(u, v)


def _edges(lane: Lane) -> tuple[Polyline, Polyline]:
    return lane.centre.shifted(lane.width_m / 2 - 0.2), lane.centre.shifted(0.2 - lane.width_m / 2)
