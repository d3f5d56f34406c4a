"""The ego's paths: the history all candidates share, their futures, and the recovery after them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.patheffects import Normal, Stroke

from branchdrive_reference.drawing.actors import box_corners
from branchdrive_reference.drawing.palette import BACKDROP, Rgb
from branchdrive_reference.drawing.scene import Candidate, DrawnScene
from branchdrive_reference.drawing.view import Layer, View

__all__ = ["CONTACT_MARKER", "END_MARKER", "draw_futures", "draw_history", "draw_route"]

CONTACT_MARKER: Mapping[str, Any] = {
    "marker": "X",
    "markersize": 9.5,
    "markeredgecolor": "#1f2328",
    "markeredgewidth": 0.9,
}
"""How a touch is marked, on the map and in the panels."""

END_MARKER: Mapping[str, Any] = {
    "marker": "s",
    "markersize": 4.6,
    "markerfacecolor": "white",
    "markeredgewidth": 1.2,
}
"""How the last observation of a rollout is marked that ends before the picture does."""


def draw_route(axes: Axes, scene: DrawnScene, view: View) -> None:
    """Draw the route, dashed."""
    u, v = view.place(*scene.route)
    axes.plot(u, v, color=BACKDROP["route"], linewidth=1.4, linestyle=(0, (7, 5)), zorder=Layer.ROUTE)


def draw_history(axes: Axes, scene: DrawnScene, view: View) -> None:
    """Draw the ego's way to the branch with its observations."""
    nominal = scene.nominal
    u, v = view.place(nominal.x_m[nominal.history], nominal.y_m[nominal.history])
    axes.plot(u, v, color=BACKDROP["ink"], linewidth=1.2, marker="o", markersize=3.4,
              markerfacecolor=BACKDROP["marking"], markeredgewidth=0.9, zorder=Layer.HISTORY)  # fmt: skip


def draw_futures(axes: Axes, scene: DrawnScene, view: View, colours: Mapping[str, Rgb]) -> None:
    """Draw every candidate's future in the order of the bank, the nominal one on top."""
    for candidate in (*scene.candidates[1:], scene.nominal):
        colour = colours[candidate.policy.key]
        _draw_paths(axes, candidate, view, colour)
        _draw_last_box(axes, scene, candidate, view, colour)
    for candidate in scene.candidates:
        rows = candidate.contacts
        u, v = view.place(candidate.x_m[rows], candidate.y_m[rows])
        if candidate.ends_early:
            last = view.place(candidate.x_m[-1:], candidate.y_m[-1:])
            axes.plot(*last, linestyle="none", color=colours[candidate.policy.key], zorder=Layer.END, **END_MARKER)
        axes.plot(u, v, linestyle="none", color=colours[candidate.policy.key], zorder=Layer.CONTACT, **CONTACT_MARKER)


def _draw_paths(axes: Axes, candidate: Candidate, view: View, colour: Rgb) -> None:
    casing = [Stroke(linewidth=3.2, foreground="white", alpha=0.75), Normal()]
    u, v = view.place(candidate.x_m[candidate.recovery], candidate.y_m[candidate.recovery])
    axes.plot(u, v, color=colour, linewidth=0.8, alpha=0.75, zorder=Layer.RECOVERY)
    u, v = view.place(candidate.x_m[candidate.future], candidate.y_m[candidate.future])
    axes.plot(u, v, color=colour, linewidth=1.7, path_effects=casing, zorder=Layer.FUTURE)
    axes.plot(u[1:], v[1:], color=colour, linestyle="none", marker="o", markersize=4.2,
              markeredgecolor="white", markeredgewidth=0.5, zorder=Layer.FUTURE)  # fmt: skip


def _draw_last_box(axes: Axes, scene: DrawnScene, candidate: Candidate, view: View, colour: Rgb) -> None:
    """The ego's outline at the last tick of the future."""
    row = int(np.flatnonzero(candidate.future)[-1])
    u, v = view.place(candidate.x_m[row : row + 1], candidate.y_m[row : row + 1])
    size_m = float(scene.record["ego_length_m"]), float(scene.record["ego_width_m"])
    corners = box_corners(float(u[0]), float(v[0]), view.angle(float(candidate.yaw_rad[row])), *size_m)
    axes.add_patch(Polygon(corners, facecolor=(*colour, 0.10), edgecolor=(*colour, 0.9), linewidth=0.9,
                           zorder=Layer.RECOVERY))  # fmt: skip
