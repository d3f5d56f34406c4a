"""Selected outcomes: contacts, separation and losses against nominal of what every selector takes, by profile."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from branchdrive.benchmark.ranking.ranking import SEPARATION
from branchdrive_reference.benchmark.figure.canvas import QUIET, axes_of, new_figure
from branchdrive_reference.benchmark.figure.policy import colour_of, label_of

__all__ = ["draw_selected", "panel", "percent_of"]


def draw_selected(results: Mapping[str, Any]) -> Figure:
    """Contacts, minimum separation, and losses beyond noise, one row of panels each, one column for each profile.

    Args:
        results: Document ``benchmark/results.json`` with ranked profiles and outcomes of selections.
    """
    profiles = results["ranking"]["profiles"]
    num_rows = max(len(profile["entries"]) for profile in profiles)
    has_noise = any(_losses(entry) is not None for profile in profiles for entry in profile["entries"])
    height = 3 if has_noise else 2
    figure = new_figure(
        2.9 * len(profiles) + 1.2, height * (0.27 * num_rows + 0.95) + 0.9, "What becomes of the selected action",
        f"Test partition, {profiles[0]['num_ranked']} groups; bars are 95 % intervals over route clusters. Ring: "
        "contacts in groups with a candidate that makes none; the dashed line is nominal.",
        results["warnings"],
    )  # fmt: skip
    panels = axes_of(figure, height, len(profiles), sharey=True)
    for column, profile in enumerate(profiles):
        entries = profile["entries"]
        contacts, separations, *losses = (panels[row * len(profiles) + column] for row in range(height))
        panel(contacts, entries, [percent_of(entry["outcomes"]["contact"]) for entry in entries])
        for place, entry in enumerate(entries):
            avoidable = 100 * entry["outcomes"]["avoidable_contact"]["value"]
            contacts.plot(avoidable, place, "o", color=colour_of(entry["selector"]), markersize=9, fillstyle="none")
        contacts.set(title=profile["profile"], xlabel="selections with contact, %")
        contacts.set_xlim(left=min(-1.0, -0.03 * contacts.get_xlim()[1]))
        panel(separations, entries, [_separation(entry) for entry in entries])
        separations.set(xlabel="mean minimum separation, m")
        for axes in losses:
            panel(axes, entries, [percent_of(_losses(entry)) for entry in entries])
            axes.set(xlabel="separation worse beyond noise, %")
    return figure


def panel(
    axes: Axes, entries: Sequence[Mapping[str, Any]], found: Sequence[tuple[float | None, float | None, float | None]]
) -> None:
    """Values with the ends of their intervals, one line for each selector."""
    for place, (entry, (value, low, high)) in enumerate(zip(entries, found, strict=True)):
        colour = colour_of(entry["selector"])
        if value is None:
            continue
        if low is not None and high is not None:
            axes.plot([low, high], [place, place], color=colour, linewidth=2.0, alpha=0.5)
        axes.plot(value, place, "o", color=colour, markersize=5.5)
        if entry["selector"] == "nominal":
            axes.axvline(value, color=QUIET, linestyle=(0, (4, 3)), linewidth=1.0)
    axes.set(ylim=(len(entries) - 0.4, -0.6), yticks=range(len(entries)))
    axes.set_yticklabels([label_of(entry) for entry in entries])
    axes.grid(axis="x")


def percent_of(rate: Mapping[str, Any] | None) -> tuple[float | None, float | None, float | None]:
    """A rate with the ends of its interval in percent; ``None`` where it is not defined."""
    if rate is None:
        return None, None, None
    value, low, high = (None if rate[name] is None else 100 * rate[name] for name in ("value", "low", "high"))
    return value, low, high


def _separation(entry: Mapping[str, Any]) -> tuple[float | None, float | None, float | None]:
    target = entry["outcomes"]["targets"][SEPARATION]
    return target["mean"], target["interval"]["cluster_low"], target["interval"]["cluster_high"]


def _losses(entry: Mapping[str, Any]) -> Mapping[str, Any] | None:
    worse: Mapping[str, Any] | None = entry["outcomes"]["targets"][SEPARATION]["worse"]
    return worse
