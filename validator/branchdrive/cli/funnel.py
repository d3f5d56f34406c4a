"""The table of the funnel."""

from __future__ import annotations

from collections import Counter

from branchdrive.raw.funnel import Funnel
from branchdrive.text.table import Column, Table

__all__ = ["funnel_table"]

_REASONS_SHOWN = 4


def funnel_table(funnel: Funnel) -> Table:
    """Groups that are left at every stage, and why others were lost."""
    rows = []
    for stage in funnel.to_json()["stages"]:
        common = Counter(stage["reasons"]).most_common(_REASONS_SHOWN)
        reasons = ", ".join(f"{rule_id} ({count})" for rule_id, count in common)
        if len(stage["reasons"]) > len(common):
            reasons += ", ..."
        rows.append([stage["title"], f"{stage['groups']:,}", f"{stage['lost']:,}" if stage["lost"] else "", reasons])
    columns = [Column.name("Stage"), Column("Groups"), Column("Lost"), Column("Reasons (groups)", is_text=True)]
    return Table("Funnel", columns, rows)
