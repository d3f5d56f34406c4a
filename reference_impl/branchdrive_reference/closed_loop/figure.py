"""Offline figures against closed loop: a point for every selector, a panel for every schedule and offline figure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from branchdrive.benchmark.protocol.selection import ENSEMBLE, ORACLE
from branchdrive_reference.benchmark.figure.canvas import HUES, INK, QUIET, axes_of, new_figure, render
from branchdrive_reference.closed_loop.arm import CONDITIONS
from branchdrive_reference.closed_loop.result import OFFLINE
from branchdrive_reference.closed_loop.selector import NOMINAL
from branchdrive_reference.drawing.palette import Rgb
from branchdrive_reference.plotting import quiet

__all__ = ["draw_orders", "drive_figures"]

Document = Mapping[str, Any]

_TITLES = {"value": "value", "regret": "regret, less is better", "contact": "contact in the window, less is better"}


def drive_figures(results: Document) -> dict[str, bytes]:
    """Files by name; none where no selector has an offline figure.

    Args:
        results: See `drive_results`.
    """
    if results["offline"] is None:
        return {}
    with quiet():
        return {f"offline.{kind}": content for kind, content in render(lambda: draw_orders(results)).items()}


def draw_orders(results: Document) -> Figure:
    """Driving scores of exact drives over offline figures of the same groups.

    Args:
        results: See `drive_results`, with offline figures.
    """
    offline = {one["selector"]: one for one in results["offline"]["selectors"]}
    arms = [arm for arm in results["arms"] if arm["condition"] == CONDITIONS[0]]
    schedules = list(dict.fromkeys((arm["every_ticks"], arm["num_decisions"]) for arm in arms))
    figure = new_figure(
        3.4 * len(OFFLINE), 3.0 * len(schedules) + 0.9, "Offline figures against closed loop",
        f"A point is a selector: means over {results['offline']['num_ranked']} groups offline, and over "
        f"{results['num_driven']} driven ones, profile {results['profile']}; lines are 95 % intervals by clusters.",
        results["warnings"],
    )  # fmt: skip
    panels = axes_of(figure, len(schedules), len(OFFLINE), sharey=True)
    for row, (every, number) in enumerate(schedules):
        own = [arm for arm in arms if (arm["every_ticks"], arm["num_decisions"]) == (every, number)]
        for column, name in enumerate(OFFLINE):
            axes, kinds = panels[row * len(OFFLINE) + column], set[str]()
            for arm in own:
                kind, colour = _kind(arm)
                score = arm["means"]["score"]
                x, y = offline[arm["selector"]][name]["value"], score["value"]
                if score["low"] is not None:
                    axes.plot([x, x], [score["low"], score["high"]], color=colour, linewidth=1.0, alpha=0.35)
                axes.plot(x, y, "o", color=colour, markersize=5.0, label=None if kind in kinds else kind)
                kinds.add(kind)
            axes.grid()
            axes.set(xlabel=_TITLES[name])
            if not column:
                decides = "decides once" if number == 1 else f"decides up to {number} times"
                axes.set(title=decides, ylabel="driving score")
    panels[0].legend(loc="lower right", fontsize=7.5)
    return figure


def _kind(arm: Document) -> tuple[str, str | Rgb]:
    """What a selector is, for the legend, and its colour."""
    name = arm["selector"]
    if name == NOMINAL:
        return "nominal", QUIET
    if name == ORACLE:
        return "oracle, looks ahead", INK
    if name.startswith(ENSEMBLE):
        return "models", HUES[1]
    if {*arm["first_choices"]} == {name}:
        return "one candidate", HUES[0]
    return "baselines and programs", HUES[2]
