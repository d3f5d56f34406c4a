"""Tables of a learning curve, with what may and may not be concluded at their head."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from branchdrive.benchmark.cell import BY_CLUSTERS, number, signed, with_ends
from branchdrive.contract.text import counted
from branchdrive.statistics.bca import LEAST_UNITS
from branchdrive.text.markdown import section_lines
from branchdrive.text.table import Column, Passage, Table

__all__ = ["CONCLUSIONS", "curve_sections", "render_curve"]

Document = Mapping[str, Any]

CONCLUSIONS = (
    "A curve says how regret on unseen route clusters of this release falls with the number of groups that a selector "
    "is fitted on, down to what the largest sample shows. It does not say where the curve leads beyond that, nor what "
    "another population or other seeds of training would give. Sizes, selectors and profiles are compared without a "
    "declared family, and intervals are not adjusted for how many there are; they resample route clusters, and know "
    "nothing of the chance in a training. Scales of inputs and utilities are those of all of `train`, and networks "
    "stop by `val`. `test` is not looked at: a claim is made there, once, by `branchdrive benchmark`."
)
"""What a reader may and may not conclude."""


def render_curve(document: Document) -> str:
    """The tables as Markdown.

    Args:
        document: See `learning_curve`.
    """
    parts = [section_lines(section, warnings_of(document)) for section in curve_sections(document)]
    return "\n\n".join(["# Learning curves", *("\n".join(lines) for lines in parts)]) + "\n"


def warnings_of(document: Document) -> list[str]:
    """What stands beside every table: nothing but that there are too few route clusters."""
    if document["num_clusters"] >= LEAST_UNITS:
        return []
    clusters = counted(document["num_clusters"], "route cluster")
    return [f"Nothing can be concluded: {clusters}, and intervals of 95 % take {LEAST_UNITS} or more."]


def curve_sections(document: Document) -> list[Table | Passage]:
    """Passage, and a table for every profile."""
    about = (
        f"{counted(document['num_groups'], 'group')} of `train` in "
        f"{counted(document['num_clusters'], 'route cluster')}; each is judged once at every size, by what was fitted "
        f"on other clusters, in {document['num_folds']} folds. Models have "
        f"{counted(document['num_seeds'], 'seed')}, the mean prediction of which chooses."
    )
    head: list[Table | Passage] = [Passage("What may and may not be concluded", [CONCLUSIONS, about])]
    return head + [_profile(document, profile) for profile in document["profiles"]]


def _profile(document: Document, profile: Document) -> Table | Passage:
    title = f"Regret by groups to fit on, profile {profile['profile']}"
    if not profile["points"]:
        return Passage(title, ["Not judged: a sample has no group with all its utilities."])
    by_place = {(point["selector"], point["size"]): point for point in profile["points"]}
    reference = document["reference"]
    sizes = document["sizes"]
    rows = [
        [
            selector,
            *(_with_ends(by_place[selector, size]["regret"], number) for size in sizes),
            "" if selector == reference else _with_ends(by_place[selector, sizes[-1]]["less_reference"], signed),
        ]
        for selector in document["selectors"]
    ]
    columns = [
        Column.name("Selector", is_code=True),
        *(Column(counted(size, "group")) for size in sizes),
        Column(f"less {reference}, {counted(sizes[-1], 'group')}"),
    ]
    note = (
        f"Mean regret over {counted(profile['num_ranked'], 'ranked group')}, less is better, with intervals of 95 % "
        "by route clusters."
    )
    return Table(title, columns, rows, [note], has_intervals=True)


def _with_ends(cell: Document, text: Any) -> str:
    low, high = BY_CLUSTERS
    return with_ends(text(cell["value"]), {"low": cell[low], "high": cell[high]})
