"""The picture of a branch group: a map with every future, panels that say why they differ, and its key.

Equal groups give equal bytes: nothing of the machine, its settings or the time goes into a file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from branchdrive.contract.timing import TICK_S
from branchdrive.formats.file_error import named
from branchdrive_reference.drawing.actors import draw_actors, draw_ego
from branchdrive_reference.drawing.futures import draw_futures, draw_history, draw_route
from branchdrive_reference.drawing.legend import (
    FOOTNOTE,
    draw_axes_of_world,
    draw_legend,
    draw_outcomes,
    draw_scale,
    draw_separation,
    draw_speed,
)
from branchdrive_reference.drawing.palette import BACKDROP, candidate_colours
from branchdrive_reference.drawing.roads import draw_roads
from branchdrive_reference.drawing.scene import DrawnScene
from branchdrive_reference.drawing.signs import draw_signs
from branchdrive_reference.drawing.view import View, view_of
from branchdrive_reference.study.label import label

__all__ = ["SIZE_PX", "draw_scene", "save", "title"]

_DPI = 120
_SIZE_IN = (16.0, 9.0)
SIZE_PX = (1920, 1080)
"""Width and height of a raster picture."""

_MAP_IN = (0.35, 1.05, 10.5, 7.0)
"""Left, bottom, width and height of the map; the other parts lie around it."""

_SETTINGS: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.edgecolor": BACKDROP["quiet"],
    "axes.linewidth": 0.8,
    "svg.hashsalt": "branchdrive",
    "text.parse_math": False,
}
_METADATA: dict[str, dict[str, str | None]] = {"png": {"Software": None}, "svg": {"Date": None, "Creator": None}}


def title(scene: DrawnScene) -> tuple[str, str]:
    """Heading and subheading of a picture."""
    record = scene.record
    heading = f"{label(record['scenario_type'])}  ·  {label(record['group_id'])}"
    trigger = (
        f"trigger {label(record['trigger_signal'])} = {record['trigger_value']:.3f} (threshold "
        f"{record['trigger_threshold']:.3f}, confidence {record['trigger_confidence']:.2f}) at tick "
        f"{record['trigger_tick']}"
    )
    branch_s = record["branch_tick"] * TICK_S
    town, route, environment = (label(record[name]) for name in ("town", "route_id", "environment"))
    place = f"town {town}  ·  route {route}  ·  {environment}"
    return heading, f"{place}  ·  branch at tick {record['branch_tick']} ({branch_s:.2f} s)  ·  {trigger}"


def _rectangle(left: float, bottom: float, width: float, height: float) -> tuple[float, float, float, float]:
    """A rectangle in inches as shares of the figure."""
    return left / _SIZE_IN[0], bottom / _SIZE_IN[1], width / _SIZE_IN[0], height / _SIZE_IN[1]


def draw_scene(scene: DrawnScene) -> Figure:
    """The picture of a group."""
    figure = Figure(figsize=_SIZE_IN, dpi=_DPI, facecolor="white")
    colours = candidate_colours(scene.bank)
    heading, subheading = title(scene)
    left_in, low_in, width_in, height_in = _MAP_IN
    for text, height, size, weight in ((heading, 8.68, 15, "bold"), (subheading, 8.33, 9.5, "normal")):
        figure.text(left_in / _SIZE_IN[0], height / _SIZE_IN[1], text, fontsize=size, fontweight=weight, va="center",
                    color=BACKDROP["ink"])  # fmt: skip
    view = view_of(scene, aspect=width_in / height_in)
    plan = figure.add_axes(_rectangle(*_MAP_IN))
    plan.set(xlim=view.u_m, ylim=view.v_m, xticks=[], yticks=[], facecolor=BACKDROP["ground"])
    posts = _draw_plan(plan, scene, view)
    draw_futures(plan, scene, view, colours)
    draw_legend(figure, scene, posts, (left_in / _SIZE_IN[0], (low_in - 0.2) / _SIZE_IN[1]))
    draw_speed(figure.add_axes(_rectangle(11.5, 6.0, 4.2, 1.75)), scene, colours)
    draw_separation(figure.add_axes(_rectangle(11.5, 3.85, 4.2, 1.75)), scene, colours)
    draw_outcomes(figure.add_axes(_rectangle(11.15, 0.3, 4.55, 3.0)), scene, colours)
    figure.text(15.7 / _SIZE_IN[0], 0.16 / _SIZE_IN[1], FOOTNOTE, fontsize=7.2, ha="right", va="center",
                color=BACKDROP["quiet"])  # fmt: skip
    return figure


def _draw_plan(plan: Axes, scene: DrawnScene, view: View) -> Mapping[str, Mapping[str, Any]]:
    """Draw everything below the futures; returns the signals and signs in view for the legend."""
    posts: Mapping[str, Mapping[str, Any]] = {}
    if scene.elements:
        draw_roads(plan, scene.elements, view)
        posts = draw_signs(plan, view, scene)
    else:
        remark = f"no map of {label(scene.record['town'])}"
        plan.text(0.985, 0.02, remark, transform=plan.transAxes, ha="right", fontsize=9,
                  color=BACKDROP["quiet"])  # fmt: skip
    draw_route(plan, scene, view)
    draw_actors(plan, scene, view)
    draw_history(plan, scene, view)
    draw_ego(plan, scene)
    draw_scale(plan, view)
    draw_axes_of_world(plan, view)
    return posts


def save(scene: DrawnScene, path: Path, file_format: Literal["png", "svg"]) -> None:
    """Draw a group into a file, which is never seen half-written."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            matplotlib.rcParams.update(_SETTINGS)
            figure = draw_scene(scene)
            with named(path):
                figure.savefig(partial, format=file_format, metadata=_METADATA[file_format])
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
