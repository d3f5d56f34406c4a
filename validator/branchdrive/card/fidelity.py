"""The section of a card on replay fidelity: thresholds, what they filter, and what is retained under them.

Source: spec/11-fidelity.md#filtering.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from branchdrive.contract.text import count_text, percent
from branchdrive.quality.text import (
    PARTITION_TITLES,
    UNITS,
    access_sentence,
    benchmark_sentences,
    filtering_sentences,
    target_sentences,
    threshold_text,
)
from branchdrive.quality.threshold import QUANTILE
from branchdrive.text.markdown import grid
from branchdrive.text.table import Column

__all__ = ["fidelity_section"]

Document = Mapping[str, Any]


def fidelity_section(
    thresholds: Document, retention: Document, ledger: Document, filtering: Document | None
) -> list[str]:
    """Thresholds, what filters, and retention; `filtering` is None where it was not recorded."""
    return [
        "## Replay fidelity",
        "",
        f"Every intervention replays its nominal up to the branch. The largest discrepancy of each variable must stay "
        f"within a threshold: the {percent(thresholds['quantile'], 0)} quantile (higher order statistic) over "
        f"{thresholds['num_groups']:,} structurally eligible training groups.",
        "",
        *grid(
            [*map(_text, ("Variable", "Criterion")), Column("Threshold")],
            [[f"`{v['name']}`", v["criterion"], threshold_text(v, thresholds)] for v in thresholds["variables"]],
        ),
        "",
        *([] if filtering is None else _filtering(filtering)),
        f"Retention over all integrity-complete groups, with {percent(retention['level'], 0)} intervals over "
        f"{retention['num_resamples']:,} resamples of whole groups:",
        "",
        *grid(
            [
                *map(_text, ("Criterion", "Partition", "Unit")),
                *map(Column, ("Passed", "Share", "Interval")),
                _text("Target"),
            ],
            [_retained(row) for row in retention["rows"]],
        ),
        "",
        *(f"On the test partition {sentence}" for sentence in target_sentences(retention)),
        access_sentence(ledger),
        *benchmark_sentences(ledger),
    ]


def _retained(row: Document) -> list[str]:
    share, interval, target = "-", "-", f"{percent(row['target'], 0)}, not judged"
    if None not in (row["share"], row["low"], row["high"]):
        share, interval = percent(row["share"]), f"{percent(row['low'])} to {percent(row['high'])}"
        target = f"{percent(row['target'], 0)}, {'met' if row['met'] else '**not met**'}"
    passed = f"{row['num_passed']:,} of {row['num_units']:,}"
    return [row["criterion"], PARTITION_TITLES[row["partition"]], UNITS[row["unit"]], passed, share, interval, target]


def _filtering(filtering: Document) -> list[str]:
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
        *grid([_text("Variable"), *map(Column, columns), _text("Filters")], rows),
        "",
        *filtering_sentences(filtering),
        "",
    ]


def _text(title: str) -> Column:
    return Column(title, is_text=True)
