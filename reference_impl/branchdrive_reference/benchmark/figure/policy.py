"""Policy value: what the choice of every selector is worth, by profile."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from branchdrive.benchmark.protocol.selection import CLEAN_ORACLE, ENSEMBLE, LEARNED, ORACLE
from branchdrive_reference.benchmark.figure.canvas import HUES, INK, QUIET, axes_of, new_figure
from branchdrive_reference.drawing.palette import Rgb

__all__ = ["colour_of", "draw_policy", "label_of"]

_NAMES = {"random": "Random", "nominal": "Nominal", "action_prior": "ActionPrior", "fixed_brake": "Fixed brake"}
_NAMES |= {ORACLE: "Oracle of the bank", CLEAN_ORACLE: "Oracle of clean drives"}


def colour_of(selector: str) -> str | Rgb:
    """Colour of a selector's marks: learned ones, the oracle, and others."""
    return (
        HUES[1] if selector.startswith((LEARNED, ENSEMBLE)) else INK if selector in (ORACLE, CLEAN_ORACLE) else HUES[0]
    )


def draw_policy(results: Mapping[str, Any]) -> Figure | None:
    """Value and regret of every selector under every profile; ``None`` where nothing was ranked.

    Args:
        results: Document ``benchmark/results.json``.
    """
    profiles = results["ranking"]["profiles"]
    if not profiles:
        return None
    num_rows = max(len(profile["entries"]) for profile in profiles)
    figure = new_figure(
        2.9 * len(profiles) + 1.2, 2 * (0.27 * num_rows + 0.95) + 0.9, "What the selected action is worth",
        f"Executed utility in the test partition, {profiles[0]['num_ranked']} groups; bars are 95 % intervals over "
        "route clusters, thin ones below them the spread over seeds; the dashed line is ActionPrior; * sees privileged "
        "evidence.",
        results["warnings"],
    )  # fmt: skip
    panels = axes_of(figure, 2, len(profiles), sharey=True)
    for column, profile in enumerate(profiles):
        _panel(panels[column], profile["entries"], "value")
        panels[column].set(title=profile["profile"], xlabel="mean utility, higher is better")
        _panel(panels[len(profiles) + column], profile["entries"], "regret")
        panels[len(profiles) + column].set(xlabel="mean regret, lower is better")
    return figure


def _panel(axes: Axes, entries: Sequence[Mapping[str, Any]], measure: str) -> None:
    for place, entry in enumerate(entries):
        name, value, ends = entry["selector"], entry[measure], entry["intervals"][measure]
        colour = colour_of(name)
        if ends["cluster_low"] is not None:
            line = ends["cluster_low"], ends["cluster_high"]
            axes.plot(line, [place, place], color=colour, linewidth=2.0, alpha=0.5)
        sd = entry["seed_sd"].get(measure)
        if sd:
            axes.plot([value - sd, value + sd], [place + 0.24] * 2, color=QUIET, linewidth=1.4)
        axes.plot(value, place, "o", color=colour, markersize=5.5)
    reference = next((entry[measure] for entry in entries if entry["selector"] == "action_prior"), None)
    if reference is not None:
        axes.axvline(reference, color=QUIET, linestyle=(0, (4, 3)), linewidth=1.0)
    axes.set(ylim=(len(entries) - 0.4, -0.6), yticks=range(len(entries)))
    axes.set_yticklabels([label_of(entry) for entry in entries])
    axes.grid(axis="x")


def label_of(entry: Mapping[str, Any]) -> str:
    """The selector, and what is to be known of it: that it is a tie rule, or sees what no sensor tells."""
    name = _NAMES.get(entry["selector"], entry["selector"])
    if entry.get("is_tie"):
        return f"{name} (tie)"
    return f"{name} *" if str(entry.get("sees")).startswith("privileged") else name
