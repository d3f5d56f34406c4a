"""What explains a map: the key to its signs, a scale, and where the world's axes point."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from branchdrive_reference.drawing.futures import CONTACT_MARKER, END_MARKER
from branchdrive_reference.drawing.layer import Layer
from branchdrive_reference.drawing.palette import ACTORS, BACKDROP
from branchdrive_reference.drawing.scene import HORIZON_S, Scene
from branchdrive_reference.drawing.view import View

__all__ = ["draw_axes_of_world", "draw_legend", "draw_scale"]

_SCALE_M = 10.0
_INSET_M = 3.0
_ROWS = 3


def draw_scale(axes: Axes, view: View) -> None:
    """A bar of ten metres in the lower left corner."""
    left, low = view.u_m[0] + _INSET_M, view.v_m[0] + _INSET_M
    ink = BACKDROP["ink"]
    halo = [withStroke(linewidth=4, foreground="white")]
    axes.plot([left, left + _SCALE_M], [low, low], color=ink, linewidth=3, solid_capstyle="butt", path_effects=halo,
              zorder=Layer.NOTE)  # fmt: skip
    axes.text(left + _SCALE_M / 2, low + 0.9, f"{_SCALE_M:.0f} m", ha="center", va="bottom", fontsize=8.8, color=ink,
              path_effects=[withStroke(linewidth=3, foreground="white")], zorder=Layer.NOTE)  # fmt: skip


def draw_axes_of_world(axes: Axes, view: View) -> None:
    """The directions of the world's x and y in the upper left corner."""
    reach, ink = 3.4, BACKDROP["ink"]
    u, v = view.u_m[0] + 2 * reach, view.v_m[1] - 2 * reach
    halo = [withStroke(linewidth=3, foreground="white")]
    for name, direction_rad in (("x", 0.0), ("y", math.pi / 2)):
        angle = view.angle(direction_rad)
        tip = (u + reach * math.cos(angle), v + reach * math.sin(angle))
        axes.annotate("", tip, (u, v), arrowprops={"arrowstyle": "-|>", "color": ink, "linewidth": 1.2, "shrinkA": 0,
                                                   "shrinkB": 0}, zorder=Layer.NOTE)  # fmt: skip
        place = (u + 1.45 * reach * math.cos(angle), v + 1.45 * reach * math.sin(angle))
        axes.text(*place, name, ha="center", va="center", fontsize=8.8, color=ink, path_effects=halo, zorder=Layer.NOTE)


def draw_legend(
    figure: Figure, scene: Scene, posts: Mapping[str, Mapping[str, Any]], place: tuple[float, float]
) -> None:
    """The key to everything on the map but the candidates, whose key is the table of outcomes.

    Args:
        figure: Where to draw.
        scene: What the map shows.
        posts: Signals and signs in view: how each is drawn, by what it is.
        place: Upper left corner in shares of the figure.
    """
    ink, quiet = BACKDROP["ink"], BACKDROP["quiet"]
    entries: list[tuple[str, Artist]] = [
        ("ego at the branch", Patch(facecolor=ink, edgecolor="white")),
        ("history, 4 s", Line2D([], [], color=ink, linewidth=1.2, marker="o", markersize=3.4,
                                           markerfacecolor="white")),
        ("future, 2.5 s at 4 Hz", Line2D([], [], color=quiet, linewidth=1.7, marker="o", markersize=4.2)),
        ("pose at its end", Patch(facecolor="none", edgecolor=quiet)),
        ("recovery, up to 4 s", Line2D([], [], color=quiet, linewidth=0.8)),
        ("touch begins", Line2D([], [], linestyle="none", color=quiet, **CONTACT_MARKER)),
    ]  # fmt: skip
    if any(candidate.ends_early for candidate in scene.candidates):
        entries.append(
            (f"rollout ends before +{HORIZON_S:.1f} s", Line2D([], [], linestyle="none", color=quiet, **END_MARKER))
        )
    present = {actor.actor_class for actor in scene.actors}
    for name, colour in ACTORS.items():
        if name in present:
            entries.append((name, Patch(facecolor=colour, edgecolor=ink, linewidth=0.9)))
    entries += [
        ("nominal future", Patch(facecolor=(*ACTORS["vehicle"], 0.13),
                                             edgecolor=(*ACTORS["vehicle"], 0.55))),
        ("velocity, 1 s", Line2D([], [], color=ink, linewidth=1.3, marker=">", markevery=[1], markersize=5)),
        ("route", Line2D([], [], color=BACKDROP["route"], linewidth=1.4, linestyle=(0, (4, 3)))),
    ]  # fmt: skip
    entries += [(name, Line2D([], [], linestyle="none", **post)) for name, post in posts.items()]
    figure.legend([handle for _, handle in entries], [text for text, _ in entries], loc="upper left",
                  bbox_to_anchor=place, ncols=math.ceil(len(entries) / _ROWS), frameon=False, fontsize=8.8,
                  borderaxespad=0, borderpad=0, handlelength=2.0, columnspacing=1.2)  # fmt: skip
