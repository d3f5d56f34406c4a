"""Guard: what is gained and what is violated along the path of multipliers, and where each guard stands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from branchdrive_reference.benchmark.figure.canvas import HUES, INK, QUIET, axes_of, new_figure

__all__ = ["draw_trade_off"]

_MARKS = {
    "nominal": ("s", INK, "nominal"),
    "action_prior": ("v", HUES[3], "ActionPrior, unguarded"),
    "unguarded": ("D", QUIET, "unguarded"),
    "global_margin": ("X", HUES[1], "global margin (paper)"),
    "conformal": ("o", HUES[0], "selection path, conformal"),
    "learn_then_test": ("^", HUES[2], "selection path, learn then test"),
}


def draw_trade_off(results: Mapping[str, Any], alpha: float) -> Figure | None:
    """Violations against gained utility for every profile; ``None`` where no guard was assessed.

    Violations are counted as the guarantee does, with equal weight for every route cluster.

    Args:
        results: Document ``benchmark/results.json``.
        alpha: Largest rate of violations.
    """
    guard = results["guard"]
    profiles = guard["profiles"]
    if not profiles:
        return None
    losses = (results["noise"] or {}).get("losses")
    repeated = losses["num_repeats_losing"] / losses["num_repeats"] if losses and losses["num_repeats"] else None
    dotted = "" if repeated is None else " Dotted: repeated nominals of training."
    figure = new_figure(
        3.0 * len(profiles) + 0.8, 4.6, f"What guarding {guard['model']} costs",
        f"Test partition, {profiles[0]['num_groups']} groups. Curve: the whole path of multipliers, from which nothing "
        f"is chosen. Bars: 95 % over route clusters. Dashed: {100 * alpha:g} %, the limit.{dotted}",
        results["warnings"],
    )  # fmt: skip
    panels = axes_of(figure, 1, len(profiles), sharex=True)
    for axes, profile in zip(panels, profiles, strict=True):
        _panel(axes, profile, alpha, repeated, guard["tolerance_m"])
    panels[0].set(ylabel="utility gained over nominal")
    handles = [
        panels[0].plot([], [], mark, color=colour, markersize=7, label=name)[0]
        for mark, colour, name in _MARKS.values()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=8.8)
    return figure


def _panel(axes: Axes, profile: Mapping[str, Any], alpha: float, repeated: float | None, tolerance_m: float) -> None:
    path = profile["trade_off"]
    violation = [100 * share for share in path["violation_of_clusters"]]
    axes.plot(violation, path["gain"], color=QUIET, linewidth=1.6, zorder=1)
    for row in profile["selections"]:
        mark, colour, _ = _MARKS[row["selection"]]
        across, up = row["figures"]["violation_of_clusters"], row["figures"]["gain"]
        if across["value"] is None or up["value"] is None:
            continue
        if None not in (up["low"], across["low"]):
            x, y = 100 * across["value"], up["value"]
            axes.plot([100 * across["low"], 100 * across["high"]], [y, y], color=colour, linewidth=1.2, alpha=0.5)
            axes.plot([x, x], [up["low"], up["high"]], color=colour, linewidth=1.2, alpha=0.5)
        axes.plot(100 * across["value"], up["value"], mark, color=colour, markersize=8, zorder=3,
                  markeredgecolor="white", markeredgewidth=0.8)  # fmt: skip
    axes.axvline(100 * alpha, color=HUES[1], linestyle=(0, (4, 3)), linewidth=1.0)
    if repeated is not None:
        axes.axvline(100 * repeated, color=INK, linestyle=(0, (1, 2)), linewidth=1.0)
    axes.axhline(0.0, color=QUIET, linewidth=0.8)
    vacuous = profile["global_margin"]["test"]["vacuous"]
    if vacuous:
        axes.set_title("global margin vacuous", loc="right", fontsize=7.8, fontweight="normal", color=HUES[1])
    axes.set(title=profile["profile"], xlabel=f"lose > {tolerance_m:g} m, mean of clusters, %")
    axes.grid()
