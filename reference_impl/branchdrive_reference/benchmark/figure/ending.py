"""How drives of selected candidates end: clean, completed and with a collision, for every selector by profile."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from branchdrive_reference.benchmark.figure.canvas import axes_of, new_figure
from branchdrive_reference.benchmark.figure.selected import panel, percent_of

__all__ = ["draw_endings"]

_ROWS = {"collision": "drives with a collision, %", "clean": "clean drives, %", "completed": "completed routes, %"}


def draw_endings(results: Mapping[str, Any]) -> Figure:
    """Collisions, clean drives and completed routes, one row of panels each, one column for each profile.

    Args:
        results: Document ``benchmark/results.json`` with ranked profiles that tell how drives end.
    """
    profiles = results["ranking"]["profiles"]
    num_rows = max(len(profile["entries"]) for profile in profiles)
    figure = new_figure(
        2.9 * len(profiles) + 1.2, len(_ROWS) * (0.27 * num_rows + 0.95) + 0.9, "How the selected drive ends",
        f"Test partition, {profiles[0]['num_ranked']} groups; recorded drives, which the expert's policy goes on with "
        "after the window; bars are 95 % intervals over route clusters, the dashed line is nominal.",
        results["warnings"],
    )  # fmt: skip
    panels = axes_of(figure, len(_ROWS), len(profiles), sharey=True)
    for column, profile in enumerate(profiles):
        for row, (name, label) in enumerate(_ROWS.items()):
            axes = panels[row * len(profiles) + column]
            panel(axes, profile["entries"], [percent_of(e["outcomes"]["endings"][name]) for e in profile["entries"]])
            axes.set(xlabel=label)
        panels[column].set(title=profile["profile"])
    return figure
