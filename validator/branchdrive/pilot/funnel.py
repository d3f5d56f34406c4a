"""The funnel of a pilot, and what it forecasts: how many groups of a collection reach each stage.

With ``k`` of ``n`` groups at a stage, the share has the exact interval of Clopper and Pearson, and of ``N`` groups the
share times ``N`` are expected. Groups of one route are alike, so that true intervals are wider.
"""

from __future__ import annotations

import math

import numpy as np

from branchdrive.contract.text import count_text, counted, percent
from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.section import Concern, Section
from branchdrive.statistics.binomial import binomial_interval
from branchdrive.text.table import Column, Table

__all__ = ["funnel_forecast"]

_TITLE = "Funnel"

_LEAST_SHARE = 0.5
"""Share of groups that qualify below which a collection is mostly thrown away."""


def funnel_forecast(pilot: Pilot) -> Section:
    """Share of seeds with a branch, stages of the funnel, and both for the collection that is wanted."""
    funnel = pilot.report.funnel
    if not pilot.parts or funnel is None or not funnel.discovered:
        reason = pilot.unread or "the validator could not judge every shard"
        return Section("funnel", _TITLE, not_examined=[reason])
    branched = 0
    for part in pilot.parts:
        branched += len(np.unique(part.view.group[part.view.branched]))
    stages = [("with_branch", "Seeds with a branch", branched)]
    stages += [(s["name"], s["title"], s["groups"]) for s in funnel.to_json()["stages"] if s["name"] != "discovered"]
    reasons = {s["name"]: s["reasons"] for s in funnel.to_json()["stages"]}
    rows, figures = [], {}
    for name, title, count in stages:
        low, high = binomial_interval(count, funnel.discovered)
        expected = [math.floor(low * pilot.num_wanted), round(count / funnel.discovered * pilot.num_wanted),
                    math.ceil(high * pilot.num_wanted)]  # fmt: skip
        rows.append(
            [
                title, f"{count:,}", percent(count / funnel.discovered, 0), f"{percent(low, 0)} to {percent(high, 0)}",
                count_text(expected[1]), f"{expected[0]:,} to {expected[2]:,}",
                ", ".join(f"{rule_id} ({lost})" for rule_id, lost in reasons.get(name, {}).items()),
            ]
        )  # fmt: skip
        figures[name] = {"groups": count, "low": low, "high": high, "expected": expected}
    share = funnel.qualified / funnel.discovered
    low, high = binomial_interval(funnel.qualified, funnel.discovered)
    facts = [
        f"{branched} of {counted(funnel.discovered, 'recorded seed')} have a branch, {funnel.qualified} qualify "
        f"({percent(low, 0)} to {percent(high, 0)}, exact binomial 95 %).",
    ]
    if low > 0:
        facts.append(
            f"For {pilot.num_wanted:,} groups that qualify, plan {math.ceil(pilot.num_wanted / high):,} to "
            f"{math.ceil(pilot.num_wanted / low):,} seeds."
        )
    concerns = []
    if share < _LEAST_SHARE:
        concerns.append(
            Concern(
                f"Of {funnel.discovered} groups {funnel.discovered - funnel.qualified} are lost: most of a collection "
                "would be.",
                "Correct what the reasons in the table name, most frequent first, and run the pilot again; "
                "`branchdrive rules ID` explains a rule.",
            )
        )
    columns = [
        Column.name("Stage"), Column("Groups"), Column("Share"), Column("95 %"),
        Column(f"Of {pilot.num_wanted:,}"), Column("Interval"), Column("Lost to", is_text=True),
    ]  # fmt: skip
    note = (
        "Exact binomial intervals, as if groups were independent; groups of one route are alike, so that true intervals"
        " are wider. Seeds that the collector left out without a record are not counted."
    )
    return Section(
        "funnel", _TITLE, facts, concerns, [Table("Forecast", columns, rows, [note])],
        figures={"seeds": funnel.discovered, "wanted": pilot.num_wanted, "stages": figures},
    )  # fmt: skip
