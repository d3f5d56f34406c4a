"""Stop lines, give-way lines, signals and signs of the map."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from branchdrive_reference.drawing.palette import BACKDROP, Rgb
from branchdrive_reference.drawing.roads import elements_in_view
from branchdrive_reference.drawing.scene import DrawnScene
from branchdrive_reference.drawing.view import Layer, View
from branchdrive_reference.town.elements import Element

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
_POSTS: Mapping[str, tuple[str, _Post]] = {
    "signal": ("signal (state unknown)", {"marker": "o", "color": BACKDROP["quiet"], "markersize": 7.5,
                                "markeredgecolor": BACKDROP["ink"], "markeredgewidth": 1.1}),
    "stop_sign": ("stop sign", {"marker": _OCTAGON, "color": _RED, "markersize": 13,
                                 "markeredgecolor": BACKDROP["marking"], "markeredgewidth": 1.8,
                                 "path_effects": [withStroke(linewidth=3.2, foreground=BACKDROP["ink"])]}),
    "yield_sign": ("give-way sign", {"marker": "v", "color": BACKDROP["marking"], "markersize": 7.5,
                                      "markeredgecolor": _RED, "markeredgewidth": 1.1}),
}  # fmt: skip
"""The post at a signal or sign: what it is called, and how it is drawn."""


def draw_signs(axes: Axes, view: View, scene: DrawnScene) -> Mapping[str, _Post]:
    """Draw stop lines, signals and signs in view; the ego's light has its colour at the branch, and lies on top.

    Returns:
        Signals and signs that were drawn: how, by what they are.
    """
    drawn: dict[str, _Post] = {}
    seen = elements_in_view(scene.elements, view)
    for element in sorted(seen, key=lambda element: _governs_ego(element, scene)):
        u, v = view.place(element["x_m"], element["y_m"])
        if element["kind"] == "stop_line":
            style = (0.0, (1.2, 1.0)) if element["marking"] == "broken" else "solid"
            axes.plot(u, v, color=BACKDROP["marking"], linewidth=2.6, linestyle=style, solid_capstyle="butt",
                      dash_capstyle="butt", zorder=Layer.MARKING)  # fmt: skip
        elif element["kind"] in _POSTS:
            name, post = _POSTS[element["kind"]]
            if _governs_ego(element, scene):
                name, post = (
                    f"ego's signal ({scene.traffic_light})",
                    {**post, "color": _LIGHTS[str(scene.traffic_light)]},
                )
            axes.plot(u, v, linestyle="none", zorder=Layer.ACTOR, **post)
            if view.sees(u, v):
                drawn[name] = post
    return dict(sorted(drawn.items()))


def _governs_ego(element: Element, scene: DrawnScene) -> bool:
    """Whether an element is the signal of the ego's lane, and its state is known."""
    is_own = element["kind"] == "signal" and element["lane_id"] is not None and element["lane_id"] == scene.lane_id
    return is_own and scene.traffic_light in _LIGHTS
