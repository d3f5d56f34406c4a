"""The actors at the branch, the paths they took in the nominal future, and the ego."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, Polygon
from numpy.typing import NDArray

from branchdrive_reference.drawing.palette import ACTORS, BACKDROP, Rgb
from branchdrive_reference.drawing.scene import DrawnActor, DrawnScene
from branchdrive_reference.drawing.view import Layer, View

__all__ = ["box_corners", "draw_actors", "draw_ego"]

_ARROW_S = 1.0
"""An arrow ends where the velocity would take an actor in this time."""

_STANDING_MPS = 0.3
_GHOST_STRIDE = 2
"""Nominal poses between two faint boxes: one every half second."""

_CIRCLED = "pedestrian"
"""Class whose boxes are circled, or they would not be found."""

_GREY: Rgb = (0.5, 0.5, 0.5)


def box_corners(u: float, v: float, angle_rad: float, length_m: float, width_m: float) -> NDArray[np.float64]:
    """Corners of an oriented box ``[4, 2]``, counter-clockwise from the front left."""
    along = 0.5 * length_m * np.array([1, -1, -1, 1])
    left = 0.5 * width_m * np.array([1, 1, -1, -1])
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return np.stack([u + cos * along - sin * left, v + sin * along + cos * left], axis=1)


def draw_actors(axes: Axes, scene: DrawnScene, view: View) -> None:
    """Draw every actor in view: its box, its velocity, and faintly its nominal future."""
    for actor in scene.actors:
        u, v = view.place(actor.x_m, actor.y_m)
        if not view.sees(u, v, actor.length_m):
            continue
        colour = ACTORS.get(actor.actor_class, _GREY)
        if math.hypot(u[-1] - u[0], v[-1] - v[0]) > 0.5:
            _draw_ghosts(axes, actor, view, colour)
        _draw_box(axes, actor, view, colour)


def _draw_ghosts(axes: Axes, actor: DrawnActor, view: View, colour: Rgb) -> None:
    u, v = view.place(actor.x_m, actor.y_m)
    axes.plot(u, v, color=colour, linewidth=1.0, linestyle=(0, (1, 1.5)), zorder=Layer.GHOST)
    for row in range(_GHOST_STRIDE, len(u), _GHOST_STRIDE):
        angle = view.angle(float(actor.yaw_rad[row]))
        corners = box_corners(float(u[row]), float(v[row]), angle, actor.length_m, actor.width_m)
        axes.add_patch(Polygon(corners, facecolor=(*colour, 0.13), edgecolor=(*colour, 0.55), linewidth=0.7,
                               zorder=Layer.GHOST))  # fmt: skip


def _draw_box(axes: Axes, actor: DrawnActor, view: View, colour: Rgb) -> None:
    ink = BACKDROP["ink"]
    u, v = (float(values[0]) for values in view.place(actor.x_m[:1], actor.y_m[:1]))
    angle = view.angle(float(actor.yaw_rad[0]))
    corners = box_corners(u, v, angle, actor.length_m, actor.width_m)
    axes.add_patch(Polygon(corners, facecolor=colour, edgecolor=ink, linewidth=0.9, zorder=Layer.ACTOR))
    if actor.actor_class == _CIRCLED:
        axes.plot([u], [v], marker="o", markersize=13, markerfacecolor=(*colour, 0.35), markeredgecolor=ink,
                  markeredgewidth=0.9, zorder=Layer.ACTOR)  # fmt: skip
    speed = math.hypot(actor.vel_x_mps, actor.vel_y_mps)
    if speed < _STANDING_MPS:
        return
    heading = view.angle(math.atan2(actor.vel_y_mps, actor.vel_x_mps))
    tip = (u + _ARROW_S * speed * math.cos(heading), v + _ARROW_S * speed * math.sin(heading))
    axes.add_patch(FancyArrowPatch((u, v), tip, arrowstyle="-|>", mutation_scale=9, linewidth=1.3, color=ink,
                                   shrinkA=0, shrinkB=0, zorder=Layer.ACTOR))  # fmt: skip


def draw_ego(axes: Axes, scene: DrawnScene) -> None:
    """Draw the ego at the branch: the origin of the view, heading along u."""
    length_m, width_m = float(scene.record["ego_length_m"]), float(scene.record["ego_width_m"])
    ink, white = BACKDROP["ink"], BACKDROP["marking"]
    axes.add_patch(Polygon(box_corners(0, 0, 0, length_m, width_m), facecolor=ink, edgecolor=white, linewidth=1.2,
                           zorder=Layer.EGO))  # fmt: skip
    nose = [(0.36 * length_m, 0.0), (0.08 * length_m, 0.3 * width_m), (0.08 * length_m, -0.3 * width_m)]
    axes.add_patch(Polygon(nose, facecolor=white, edgecolor="none", zorder=Layer.EGO))
