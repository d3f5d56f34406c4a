"""What explains a map: the key to its signs, a scale, and where the world's axes point.

Panels beside the map: speed and separation of every candidate over time, and what came of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from branchdrive.contract.timing import ACTIVE_TICKS, TICK_S
from branchdrive_reference.drawing.futures import CONTACT_MARKER, END_MARKER
from branchdrive_reference.drawing.palette import ACTORS, BACKDROP, Rgb
from branchdrive_reference.drawing.scene import HISTORY_TICKS, HORIZON_S, Array, Candidate, DrawnScene, outcome_texts
from branchdrive_reference.drawing.view import Layer, View

__all__ = [
    "FOOTNOTE",
    "draw_axes_of_world",
    "draw_legend",
    "draw_outcomes",
    "draw_scale",
    "draw_separation",
    "draw_speed",
]

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
    figure: Figure, scene: DrawnScene, posts: Mapping[str, Mapping[str, Any]], place: tuple[float, float]
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


_MOST_SEPARATION_M = 60.0
_RANGE_S = (-HISTORY_TICKS * TICK_S, HORIZON_S)
_ACTIVE_S = ACTIVE_TICKS * TICK_S
_HEADER_ROWS = 2

FOOTNOTE = "a touch counts as gap 0; otherwise static objects count only inside the route corridor"
"""What a gap is, in the panel of gaps and in the table."""


def draw_speed(axes: Axes, scene: DrawnScene, colours: Mapping[str, Rgb]) -> None:
    """Speed over time."""
    _prepare(axes, "Speed (m/s)")
    _draw_lines(axes, scene, colours, lambda candidate: candidate.speed_mps)
    axes.set_ylim(min(0.0, *(float(candidate.speed_mps.min()) for candidate in scene.candidates)) - 0.4, None)
    axes.tick_params(labelbottom=False)
    for middle_s, text in ((_RANGE_S[0] / 2, "history"), (_ACTIVE_S / 2, "intervention"),
                           ((_ACTIVE_S + _RANGE_S[1]) / 2, "recovery")):  # fmt: skip
        axes.text(middle_s, 1.02, text, transform=axes.get_xaxis_transform(), ha="center", va="bottom", fontsize=8,
                  color=BACKDROP["quiet"])  # fmt: skip


def draw_separation(axes: Axes, scene: DrawnScene, colours: Mapping[str, Rgb]) -> None:
    """Separation over time; lines break where no relevant actor is in range, and touches lie at gap 0."""
    _prepare(axes, "Gap to the nearest relevant actor (m)")
    _draw_lines(axes, scene, colours, lambda candidate: candidate.separation_m, touch=0.0)
    gaps = np.concatenate([candidate.separation_m for candidate in scene.candidates])
    most_m = float(np.nanmax(gaps)) if np.isfinite(gaps).any() else 1.0
    top_m = min(1.08 * most_m + 0.5, _MOST_SEPARATION_M)
    axes.set_ylim(-0.05 * top_m, top_m)
    axes.set_xlabel("time since the branch (s)")


def _prepare(axes: Axes, title: str) -> None:
    axes.set_title(title, loc="left", fontsize=10, fontweight="bold", pad=16 if title.startswith("Speed") else 5)
    axes.axvspan(0.0, _ACTIVE_S, color=BACKDROP["window"], zorder=0)
    axes.axvline(0.0, color=BACKDROP["ink"], linewidth=0.9, zorder=1)
    axes.axhline(0.0, color=BACKDROP["quiet"], linewidth=0.6, zorder=1)
    axes.grid(axis="y", color="#e3e5e8", linewidth=0.6, zorder=0)
    axes.set_axisbelow(True)
    axes.set_xlim(*_RANGE_S)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_lines(
    axes: Axes,
    scene: DrawnScene,
    colours: Mapping[str, Rgb],
    values: Callable[[Candidate], Array],
    *,
    touch: float | None = None,
) -> None:
    """Draw a line for every candidate; its touches lie on the line, or at the height `touch`."""
    nominal = scene.nominal
    axes.plot(nominal.time_s[nominal.history], values(nominal)[nominal.history], color=BACKDROP["ink"], linewidth=1.3)
    for candidate in (*scene.candidates[1:], nominal):
        colour, heights_of = colours[candidate.policy.key], values(candidate)
        for part, width in ((candidate.recovery, 0.8), (candidate.future, 1.6)):
            axes.plot(candidate.time_s[part], heights_of[part], color=colour, linewidth=width, zorder=3)
        if candidate.ends_early:
            axes.plot(candidate.time_s[-1:], heights_of[-1:], linestyle="none", color=colour, zorder=4, **END_MARKER)
        rows = candidate.contacts
        heights = heights_of[rows] if touch is None else np.full(len(rows), touch)
        axes.plot(candidate.time_s[rows], heights, linestyle="none", color=colour, zorder=4,
                  **{**CONTACT_MARKER, "markersize": 7})  # fmt: skip


def draw_outcomes(axes: Axes, scene: DrawnScene, colours: Mapping[str, Rgb]) -> None:
    """One row for every candidate: its colour, what the future brought, and when it first touched something."""
    axes.set_axis_off()
    axes.set(xlim=(0, 1), ylim=(0, 1))
    end_s = f"+{_ACTIVE_S:.1f} s"
    columns = (
        (0.115, "left", "candidate"), (0.51, "right", f"least gap\nto {end_s}"), (0.70, "right", f"speed\nat {end_s}"),
        (1.0, "right", f"first touch\nto +{_RANGE_S[1]:.1f} s"),
    )  # fmt: skip
    height = 1.0 / (len(scene.candidates) + _HEADER_ROWS)
    for x, side, text in columns:
        axes.text(x, 1.0 - 0.8 * height, text, ha=side, va="center", fontsize=8.5, fontweight="bold",
                  color=BACKDROP["ink"], linespacing=1.15)  # fmt: skip
    for row, candidate in enumerate(scene.candidates):
        y = 1.0 - (row + _HEADER_ROWS + 0.5) * height
        colour = colours[candidate.policy.key]
        axes.plot([0.0, 0.085], [y, y], color=colour, linewidth=2.4, solid_capstyle="butt")
        axes.plot([0.0425], [y], color=colour, marker="o", markersize=5, markeredgecolor="white", markeredgewidth=0.5)
        for (x, side, _), text in zip(columns, outcome_texts(candidate), strict=True):
            axes.text(x, y, text, ha=side, va="center", fontsize=8.5, color=BACKDROP["ink"])
