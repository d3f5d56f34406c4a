"""Leakage: how well replays give away their action before the branch, and the gate's p-values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from branchdrive_reference.benchmark.figure.canvas import HUES, INK, QUIET, axes_of, new_figure

__all__ = ["draw_leakage"]

_STATUS = {"pass": HUES[0], "inconclusive": HUES[4]}
_FLAGGED = HUES[1]


def draw_leakage(document: Mapping[str, Any]) -> Figure:
    """Accuracy of the classifiers of the battery with their intervals, and the tests of the gate.

    Args:
        document: Document ``quality/leakage.json``.
    """
    gate, ways = document["gate"], document["battery"]["ways"]
    alpha = document["protocol"]["gate"]["alpha"]
    figure = new_figure(
        10.4, 4.3, "Does the time before the branch give the action away?",
        f"Gate: {gate['verdict']} at a family-wise level of {alpha:g}. The battery beside it is a diagnostic.",
    )  # fmt: skip
    panels = axes_of(figure, 1, len(ways) + 1, width_ratios=[1.0] * len(ways) + [1.25])
    for axes, way in zip(panels, ways, strict=False):
        _battery(axes, way)
    _gate(panels[-1], gate, alpha)
    return figure


def _battery(axes: Axes, way: Mapping[str, Any]) -> None:
    tests = [test for test in way["tests"] if test.get("score")]
    for place, test in enumerate(tests):
        score, colour = test["score"], _STATUS.get(test["status"], _FLAGGED)
        low, high = score["accuracy_interval"]
        axes.plot([low, high], [place, place], color=colour, linewidth=2.2, solid_capstyle="round")
        axes.plot(score["accuracy"], place, "o", color=colour, markersize=6)
    axes.axvline(way["chance"], color=QUIET, linestyle=(0, (4, 3)), linewidth=1.1)
    axes.text(way["chance"], -0.55, "  chance", color=QUIET, fontsize=8, ha="left", va="center")
    top = max([way["chance"], *(test["score"]["accuracy_interval"][1] for test in tests)])
    axes.set(xlim=(0, 1.08 * top), ylim=(len(tests) - 0.4, -0.8), yticks=range(len(tests)))
    axes.set(xlabel="held-out accuracy; lines: 95 % intervals", title=f"Battery, {way['name']}")
    axes.set_yticklabels([test["name"].replace("_", " + ") for test in tests])
    axes.grid(axis="x")
    for place, test in enumerate(tests):
        axes.text(1.02, place, test["status"], ha="left", va="center", fontsize=8, transform=axes.get_yaxis_transform(),
                  color=_STATUS.get(test["status"], _FLAGGED))  # fmt: skip


def _gate(axes: Axes, gate: Mapping[str, Any], alpha: float) -> None:
    tests = gate["tests"]
    axes.set(title="Gate, adjusted p")
    if not tests:
        axes.text(0.5, 0.5, gate["reason"], ha="center", va="center", wrap=True, transform=axes.transAxes, color=INK)
        axes.set(xticks=[], yticks=[])
        return
    for place, test in enumerate(tests):
        p = test["p_adjusted"]
        colour = _FLAGGED if p <= alpha else HUES[0]
        axes.plot([alpha / 10, p], [place, place], color=colour, linewidth=2.2, alpha=0.35)
        axes.plot(p, place, "o", color=colour, markersize=6)
        axes.text(p, place - 0.17, f"{p:.2g}", ha="right", va="bottom", fontsize=8, color=INK)
    axes.axvline(alpha, color=_FLAGGED, linestyle=(0, (4, 3)), linewidth=1.1)
    axes.text(alpha, -0.55, f"  level {alpha:g}", color=_FLAGGED, fontsize=8, ha="left", va="center")
    axes.set(xscale="log", xlim=(alpha / 10, 2.0), ylim=(len(tests) - 0.4, -0.8), yticks=range(len(tests)))
    ticks = [10.0**power for power in range(0, -9, -1) if 10.0**power >= alpha / 10]
    axes.set(xlabel="p, Holm-adjusted", xticks=ticks)
    axes.set_xticklabels([f"{tick:g}" for tick in ticks], fontsize=8.3)
    axes.minorticks_off()
    axes.set_yticklabels([test["name"].replace("_", " ") for test in tests])
    axes.grid(axis="x")
