"""Prediction: errors of the models with the spread over their seeds, and what shuffling does to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from branchdrive.benchmark.prediction.metric.metric import HEADLINES
from branchdrive.driving.target import TARGETS
from branchdrive_reference.benchmark.figure.canvas import HUES, INK, QUIET, axes_of, new_figure

__all__ = ["draw_prediction"]

_DRAWN = ("macro_nmae", "ade_m", "fde_m")
_SHARE = "share of the training IQR"


def draw_prediction(results: Mapping[str, Any]) -> Figure:
    """Headline errors, NMAE of every target, and macro NMAE under shuffles; lower is better throughout.

    Args:
        results: Document ``benchmark/results.json``.
    """
    models = [model["id"] for model in results["models"]]
    found = {(row["model"], row["metric"]): row for row in results["prediction"]["estimates"]}
    models = [model for model in models if (model, "macro_nmae") in found]
    num_groups = max((found[model, "macro_nmae"]["num_groups"] for model in models), default=0)
    figure = new_figure(
        11.4, 6.4, "How well the models predict",
        f"Test partition, {num_groups} groups. Small marks: seeds; lines: 95 % intervals over route clusters. "
        "Lower is better.",
        results["warnings"],
    )  # fmt: skip
    colours = {model: HUES[i % len(HUES)] for i, model in enumerate(models)}
    panels = axes_of(figure, 2, 3)
    for axes, metric in zip(panels, (metric for metric in HEADLINES if metric.name in _DRAWN), strict=False):
        _dots(axes, [found[model, metric.name] for model in models], colours)
        axes.set(title=metric.title, ylabel=_SHARE if metric.unit == "1" else metric.unit)
    grid = panels[3].get_gridspec()
    for axes in panels[3:5]:
        axes.remove()
    _targets(figure.add_subplot(grid[1, :2]), models, found, colours)  # type: ignore[index]
    _shuffles(panels[5], models, results["diagnostics"]["shuffles"], colours)
    return figure


def _dots(axes: Axes, rows: Sequence[Mapping[str, Any]], colours: Mapping[str, str]) -> None:
    for place, row in enumerate(rows):
        if row["value"] is None:
            continue
        colour, ends = colours[row["model"]], row["interval"]
        if ends["cluster_low"] is not None:
            line = ends["cluster_low"], ends["cluster_high"]
            axes.plot([place, place], line, color=colour, linewidth=2.0, alpha=0.55)
        axes.plot(place, row["value"], "o", color=colour, markersize=7)
        seeds = [value for value in row["by_seed"] if value is not None]
        if len(seeds) > 1:
            axes.plot([place + 0.16] * len(seeds), seeds, "_", color=INK, markersize=7, markeredgewidth=1.0)
        top = max(value for value in (row["value"], ends["cluster_high"]) if value is not None)
        axes.annotate(f"{row['value']:.3f}", (place, top), (0, 6), textcoords="offset points", ha="center",
                      va="bottom", fontsize=8.3, color=INK)  # fmt: skip
    axes.set(xlim=(-0.6, len(rows) - 0.4), xticks=range(len(rows)), ylim=(0, 1.08 * axes.get_ylim()[1]))
    axes.set_xticklabels([row["model"] for row in rows])
    axes.grid(axis="y")


def _targets(axes: Axes, models: Sequence[str], found: Mapping[Any, Any], colours: Mapping[str, str]) -> None:
    width = 0.8 / max(len(models), 1)
    for i, model in enumerate(models):
        rows = [found[model, f"nmae.{target.name}"] for target in TARGETS]
        places = [place - 0.4 + (i + 0.5) * width for place in range(len(rows))]
        axes.bar(places, [row["value"] or 0.0 for row in rows], 0.9 * width, color=colours[model], label=model)
        for place, row in zip(places, rows, strict=True):
            if row["interval"]["cluster_low"] is not None:
                ends = row["interval"]["cluster_low"], row["interval"]["cluster_high"]
                axes.plot([place, place], ends, color=INK, linewidth=0.9)
    axes.set(title="NMAE of every target", ylabel=_SHARE, xticks=range(len(TARGETS)))
    axes.set_xticklabels([target.name.rsplit("_", 1)[0].replace("_", " ") for target in TARGETS], fontsize=8.6)
    axes.set(ylim=(0, 1.14 * axes.get_ylim()[1]))
    axes.legend(ncols=len(models), fontsize=8.6, loc="upper right")
    axes.set_axisbelow(True)
    axes.grid(axis="y")


def _shuffles(
    axes: Axes, models: Sequence[str], shuffles: Sequence[Mapping[str, Any]], colours: Mapping[str, str]
) -> None:
    kinds = list(dict.fromkeys(row["kind"] for row in shuffles))
    rows = {(row["model"], row["kind"]): row for row in shuffles if row["metric"] == "macro_nmae"}
    drawn = [model for model in models if (model, kinds[0] if kinds else "") in rows]
    width = 0.8 / max(len(drawn), 1)
    for i, model in enumerate(drawn):
        bars = [rows[model, kinds[0]]["value"], *(rows[model, kind]["shuffled"] for kind in kinds)]
        places = [place - 0.4 + (i + 0.5) * width for place in range(len(bars))]
        axes.bar(places, [value or 0.0 for value in bars], 0.9 * width, color=colours[model])
        for place, kind in zip(places[1:], kinds, strict=True):
            row = rows[model, kind]
            if row["shuffle_sd"] is not None and row["shuffled"] is not None:
                ends = row["shuffled"] - row["shuffle_sd"], row["shuffled"] + row["shuffle_sd"]
                axes.plot([place, place], ends, color=INK, linewidth=0.9)
    axes.set(
        title="Macro NMAE, shuffled",
        ylabel=_SHARE,
        xlabel="lines: spread over shuffles",
        xticks=range(len(kinds) + 1),
    )
    axes.set_xticklabels(["as it is", *kinds], fontsize=8.6)
    axes.grid(axis="y")
    if not drawn:
        axes.text(0.5, 0.5, "no shuffles", ha="center", transform=axes.transAxes, color=QUIET)
