"""The table of the funnel, and that of the groups that it loses."""

from __future__ import annotations

from collections.abc import Sequence

from branchdrive.contract.rule import cause_order
from branchdrive.contract.text import counted
from branchdrive.engine.report import Report
from branchdrive.raw.funnel import Funnel
from branchdrive.text.table import Column, Table

__all__ = ["NO_GROUPS", "funnel_table", "lost_groups_table", "no_funnel"]

NO_GROUPS = "drives are in no branch group"

_REASONS_SHOWN = 6


def no_funnel(report: Report) -> str | None:
    """Why there is no table of the funnel; ``None`` where there is one."""
    if report.funnel is None:
        return "not judged"
    return NO_GROUPS if report.is_of_drives else None


def funnel_table(funnel: Funnel) -> Table:
    """Groups that are left at every stage, and why others were lost, causes before their consequences."""
    rows = []
    for stage in funnel.to_json()["stages"]:
        counts = stage["reasons"]
        reasons = _listed([f"{rule_id} ({counts[rule_id]})" for rule_id in sorted(counts, key=cause_order)])
        rows.append([stage["title"], f"{stage['groups']:,}", f"{stage['lost']:,}" if stage["lost"] else "", reasons])
    columns = [Column.name("Stage"), Column("Groups"), Column("Lost"), Column("Reasons (groups)", is_text=True)]
    return Table("Funnel", columns, rows)


def lost_groups_table(report: Report, most: int) -> Table | None:
    """Groups that do not qualify, at most `most` of them, each with its reason; ``None`` where all do."""
    lost = [group for group in report.groups or () if not group.qualifies]
    if not lost:
        return None
    rows = [[group.group_id, group.stage or "", group.reason, _listed(group.rules)] for group in lost[:most]]
    columns = [
        Column.name("Group", is_code=True), Column("Lost at", is_text=True), Column("Why", is_text=True, is_code=True),
        Column("Rules", is_text=True),
    ]  # fmt: skip
    more = f"and {counted(len(lost) - most, 'other group')}; --format json lists all"
    title = f"Groups that do not qualify: {len(lost):,} of {len(report.groups or ()):,}"
    return Table(title, columns, rows, [more] if len(lost) > most else [])


def _listed(rules: Sequence[str]) -> str:
    more = f" and {len(rules) - _REASONS_SHOWN} more" if len(rules) > _REASONS_SHOWN else ""
    return ", ".join(rules[:_REASONS_SHOWN]) + more
