"""Stop lines, give-way lines and signals at the ends of the lanes that lead to junctions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from branchdrive_reference.drawing.palette import BACKDROP, Rgb
from branchdrive_reference.drawing.roads import lanes_in_view
from branchdrive_reference.drawing.scene import Scene
from branchdrive_reference.drawing.view import Layer, View
from branchdrive_reference.geometry.polyline import Polyline
from branchdrive_reference.town.crossroads import Control
from branchdrive_reference.town.lane import Lane, LaneSide, Turn
from branchdrive_reference.town.network import RoadNetwork

__all__ = ["draw_signs"]

_RED: Rgb = (0.84, 0.13, 0.16)
_LIGHTS: Mapping[str, Rgb] = {
    "green": (0.10, 0.62, 0.32),
    "yellow": (0.95, 0.72, 0.05),
    "red": _RED,
}
_OCTAGON = (8, 0, 22.5)
"""Marker of a regular octagon that stands on a side."""

_Post = Mapping[str, Any]
_POSTS: Mapping[Control, tuple[str, _Post]] = {
    Control.SIGNAL: ("signal (state unknown)", {"marker": "o", "color": BACKDROP["quiet"], "markersize": 7.5,
                                "markeredgecolor": BACKDROP["ink"], "markeredgewidth": 1.1}),
    Control.STOP: ("stop sign", {"marker": _OCTAGON, "color": _RED, "markersize": 13,
                                 "markeredgecolor": BACKDROP["marking"], "markeredgewidth": 1.8,
                                 "path_effects": [withStroke(linewidth=3.2, foreground=BACKDROP["ink"])]}),
    Control.YIELD: ("give-way sign", {"marker": "v", "color": BACKDROP["marking"], "markersize": 7.5,
                                      "markeredgecolor": _RED, "markeredgewidth": 1.1}),
}  # fmt: skip
"""The post beside an approach: what it is called, and how it is drawn."""

_BESIDE_M = 1.2
"""How far outside the paved road a signal or sign stands."""


def draw_signs(axes: Axes, network: RoadNetwork, view: View, scene: Scene) -> Mapping[str, _Post]:
    """Draw what orders the traffic of every junction in view; the ego's light has its colour at the branch.

    Returns:
        Signals and signs that were drawn: how, by what they are.
    """
    ego_lane = network.lanes.get(scene.lane_id or "")
    drawn: dict[str, _Post] = {}
    for lane in lanes_in_view(network, view):
        if lane.turn is not Turn.FOLLOW or not lane.junction:
            continue
        junction = network.junctions[lane.junction]
        if junction.control is not Control.SIGNAL and lane.way[0] in junction.major:
            continue
        _draw_line(axes, lane, view, is_solid=junction.control is not Control.YIELD)
        is_ego_s = ego_lane is not None and ego_lane.way == lane.way
        name, post = _POSTS[junction.control]
        state = scene.traffic_light
        if junction.control is Control.SIGNAL and is_ego_s and state is not None and state in _LIGHTS:
            name, post = f"ego's signal ({state})", {**post, "color": _LIGHTS[state]}
        if _draw_post(axes, lane, view, post):
            drawn[name] = post
    return dict(sorted(drawn.items()))


def _draw_line(axes: Axes, lane: Lane, view: View, *, is_solid: bool) -> None:
    """A line across the end of a lane."""
    x, y = zip(*((side.x_m[-1], side.y_m[-1]) for side in _edges(lane)), strict=True)
    u, v = view.place(np.array(x), np.array(y))
    style = "solid" if is_solid else (0.0, (1.2, 1.0))
    axes.plot(u, v, color=BACKDROP["marking"], linewidth=2.6, linestyle=style, solid_capstyle="butt",
              dash_capstyle="butt", zorder=Layer.MARKING)  # fmt: skip


def _draw_post(axes: Axes, lane: Lane, view: View, post: _Post) -> bool:
    """A signal or sign to the right of the road's outermost lane; whether it is in view."""
    if lane.right is LaneSide.SAME_DIRECTION:
        return False
    beside = lane.centre.shifted(-lane.right_edge_m - _BESIDE_M)
    u, v = view.place(beside.x_m[-1:], beside.y_m[-1:])
    axes.plot(u, v, linestyle="none", zorder=Layer.ACTOR, **post)
    return view.sees(u, v)


def _edges(lane: Lane) -> tuple[Polyline, Polyline]:
    return lane.centre.shifted(lane.width_m / 2 - 0.2), lane.centre.shifted(0.2 - lane.width_m / 2)
