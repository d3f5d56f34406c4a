"""Learning curves: regret over the number of groups to fit on, a panel for every profile."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from branchdrive.benchmark.cell import BY_CLUSTERS
from branchdrive.benchmark.protocol.selection import ENSEMBLE
from branchdrive_reference.benchmark.curve import NOMINAL
from branchdrive_reference.benchmark.curve_table import warnings_of
from branchdrive_reference.benchmark.figure.canvas import HUES, INK, QUIET, axes_of, new_figure, render
from branchdrive_reference.plotting import quiet

__all__ = ["curve_figures", "draw_curve"]

Document = Mapping[str, Any]

_COLUMNS = 3
_MARKERS = "osD^vP*X"


def curve_figures(document: Document) -> dict[str, bytes]:
    """Files by name.

    Args:
        document: See `learning_curve`.
    """
    with quiet():
        return {f"curve.{kind}": content for kind, content in render(lambda: draw_curve(document)).items()}


def draw_curve(document: Document) -> Figure:
    """Regrets with intervals over sizes; what sees nothing of a group is grey."""
    profiles, selectors = document["profiles"], document["selectors"]
    num_rows = -(-len(profiles) // _COLUMNS)
    figure = new_figure(
        10.5, 3.1 * num_rows + 1.2, "Learning curves",
        f"Mean regret on {document['num_clusters']} route clusters of train, each judged by what was fitted on others; "
        "lines are 95 % intervals by clusters. Less is better.",
        warnings_of(document),
    )  # fmt: skip
    panels = axes_of(figure, num_rows, _COLUMNS)
    spread = max(document["sizes"]) / 150
    for place, axes in enumerate(panels):
        if place >= len(profiles):
            axes.axis("off")
            continue
        for k, selector in enumerate(selectors):
            points = [point for point in profiles[place]["points"] if point["selector"] == selector]
            shift = spread * (k - len(selectors) / 2)
            x = [point["size"] + shift for point in points]
            colour = _colour(selectors, k)
            is_model = selector.startswith(ENSEMBLE)
            for at, point in zip(x, points, strict=True):
                ends = [point["regret"][end] for end in BY_CLUSTERS]
                if None not in ends:
                    axes.plot([at, at], ends, color=colour, linewidth=1.0, alpha=0.4)
            axes.plot(
                x, [point["regret"]["value"] for point in points], color=colour, label=selector,
                marker=_MARKERS[k % len(_MARKERS)], markersize=4.5, linestyle="-" if is_model else ":",
            )  # fmt: skip
        axes.grid()
        axes.set(title=profiles[place]["profile"], xlabel="groups to fit on", xticks=document["sizes"])
        axes.set_ylim(bottom=0)
        if place % _COLUMNS == 0:
            axes.set_ylabel("regret")
    lines, names = panels[0].get_legend_handles_labels()
    home = panels[len(profiles)] if len(profiles) < len(panels) else panels[0]
    home.legend(lines, names, loc="center" if home is not panels[0] else "best", fontsize=8, ncols=2)
    return figure


def _colour(selectors: list[str], k: int) -> Any:
    """Colour of a selector: models and what reads histories in hues, nominal and constants in grey and ink."""
    if selectors[k] == NOMINAL:
        return QUIET
    return INK if k == 1 else HUES[(k - 2) % len(HUES)]
