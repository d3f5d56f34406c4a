"""Attrition: branch groups that reach every stage of a release, and where the last of them belong."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from branchdrive_reference.benchmark.figure.canvas import HUES, INK, axes_of, new_figure

__all__ = ["draw_attrition"]

_UNPARTED = "#8a929b"


def draw_attrition(population: Mapping[str, Any]) -> Figure:
    """One bar for every stage, by partition as soon as there are partitions.

    Args:
        population: Document ``quality/population.json``.
    """
    stages, partitions = population["stages"], population["partitions"]
    most = max(stage["total"] for stage in stages) or 1
    figure = new_figure(
        8.4, 0.42 * len(stages) + 1.55, "What is left of the branch groups",
        f"Groups at each stage; each complete bank has {population['num_policies']} trajectories.",
    )  # fmt: skip
    (axes,) = axes_of(figure, 1, 1)
    for place, stage in enumerate(stages):
        left = 0
        parts = stage["groups"] or {"": stage["total"]}
        for name in ("", *partitions):
            width = parts.get(name) or 0
            colour = HUES[partitions.index(name)] if name else _UNPARTED
            axes.barh(place, width, left=left, height=0.66, color=colour, edgecolor="white", linewidth=0.8)
            left += width
        share = f"{stage['total']:,} ({stage['total'] / most:.0%})"
        axes.text(left + 0.01 * most, place, share, va="center", color=INK, fontsize=8.8)
    axes.set(xlim=(0, 1.16 * most), yticks=range(len(stages)), xlabel="branch groups")
    axes.set_yticklabels([stage["title"] for stage in stages])
    axes.invert_yaxis()
    axes.grid(axis="x")
    for name in ("", *partitions):
        colour = HUES[partitions.index(name)] if name else _UNPARTED
        axes.barh([0], [0], color=colour, label=name or "before the split")
    figure.legend(loc="outside lower center", ncols=len(partitions) + 1, fontsize=8.8)
    return figure
