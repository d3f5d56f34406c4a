"""What a card says of thresholds beside their values: what they filter, and the figures that decide nothing.

Source: spec/11-fidelity.md#filtering.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from branchdrive.contract.text import count_text, percent
from branchdrive.quality.text import filtering_sentences
from branchdrive.quality.threshold import QUANTILE
from branchdrive.text.markdown import grid
from branchdrive.text.table import Column

__all__ = ["filtering_lines"]


def filtering_lines(filtering: Mapping[str, Any]) -> list[str]:
    """Figures beside the thresholds, and which of them filter nothing."""
    above = ("Frames above, mean", f"Frames above, {percent(QUANTILE, 0)} of groups")
    columns = ("Threshold", "Over variation", *above, "Fail", "Alone")
    rows = [
        [
            f"`{v['name']}`",
            "-" if v["threshold"] is None else f"{v['threshold']:.4g}",
            "-" if v["over_variation"] is None else f"{v['over_variation']:.2g}",
            *("-" if v[name] is None else percent(v[name]) for name in ("mean_share_above", "share_above")),
            *(count_text(v[name]) for name in ("num_failing", "num_failing_alone")),
            {True: "yes", False: "**no**", None: "decides nothing"}[v["filters"]],
        ]
        for v in filtering["variables"]
    ]
    return [
        "Beside the largest discrepancy: the threshold over what nominals move in the window themselves, the share of "
        f"frames above the floor (mean over pairs of {filtering['num_groups']:,} training groups, and of the worst "
        f"replay of a group), and how many of {filtering['num_pairs']:,} pairs fail a variable, and it alone. "
        "These figures decide nothing.",
        "",
        *grid([Column("Variable", is_text=True), *map(Column, columns), Column("Filters", is_text=True)], rows),
        "",
        *filtering_sentences(filtering),
        "",
    ]
