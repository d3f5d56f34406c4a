"""The table of the funnel, and that of the groups that it loses."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from branchdrive.contract.rule import cause_order
from branchdrive.contract.text import counted
from branchdrive.engine.group_result import GroupResult
from branchdrive.engine.report import Report
from branchdrive.raw.funnel import Funnel
from branchdrive.text.brief import brief
from branchdrive.text.table import Column, Table

__all__ = ["NO_GROUPS", "LostGroups", "funnel_table", "lost_groups", "lost_groups_table", "lost_title", "no_funnel"]

NO_GROUPS = "drives are in no branch group"

_REASONS_SHOWN = 6
_NAMES_SHOWN = 3


class LostGroups(NamedTuple):
    """Groups that are lost for the same reason.

    Attributes:
        text: Which they are, in few words.
        names: All of them, in the order of the dataset.
        lacks: What they are that they are lost for.
        reason: What the first of them lacks, and whether others found other values.
        rules: Rules that they fail there.
        further: Rules that they fail beside these.
    """

    text: str
    names: tuple[str, ...]
    lacks: str
    reason: str
    rules: tuple[str, ...]
    further: tuple[str, ...]


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


def lost_groups(report: Report) -> list[LostGroups]:
    """Groups that do not qualify, those that lack the same together, in the order of the first of each."""
    same: dict[object, list[tuple[int, GroupResult]]] = {}
    for place, group in enumerate(report.groups or ()):
        if not group.qualifies:
            column = group.detail.partition(":")[0]
            said = (group.stage, group.reason.removesuffix(group.detail), column, group.rules, group.further)
            same.setdefault(said, []).append((place, group))
    return [_lost(part) for part in same.values()]


def _lost(part: Sequence[tuple[int, GroupResult]]) -> LostGroups:
    places, groups = zip(*part, strict=True)
    first, names = groups[0], tuple(group.group_id for group in groups)
    differs = any(group.reason != first.reason for group in groups)
    (reason,) = brief(first.reason)
    reason += " - the first of them; others differ in the values" if differs else ""
    is_run = all(after == before + 1 for before, after in pairwise(places))
    if len(names) > _NAMES_SHOWN and is_run:
        text = f"{names[0]} to {names[-1]} ({counted(len(names), 'group')})"
    else:
        left = len(names) - _NAMES_SHOWN
        text = ", ".join(names[:_NAMES_SHOWN]) + (f" and {counted(left, 'more group')}" if left > 0 else "")
    return LostGroups(text, names, first.lacks, reason, first.rules, first.further)


def lost_title(report: Report) -> str:
    """How many groups do not qualify, of how many."""
    groups = report.groups or ()
    return f"Groups that do not qualify: {sum(not group.qualifies for group in groups):,} of {len(groups):,}"


def lost_groups_table(report: Report, most: int) -> Table | None:
    """Groups that do not qualify with their reasons, in at most `most` rows; ``None`` where all do."""
    lost = lost_groups(report)
    if not lost:
        return None
    rows = [[same.text, same.lacks, same.reason, _rules(same)] for same in lost[:most]]
    columns = [
        Column.name("Group", is_code=True), Column("Lost as", is_text=True), Column("Why", is_text=True, is_code=True),
        Column("Rules", is_text=True),
    ]  # fmt: skip
    more = f"and {counted(sum(len(same.names) for same in lost[most:]), 'other group')}; --format json lists all"
    return Table(lost_title(report), columns, rows, [more] if len(lost) > most else [])


def _rules(same: LostGroups) -> str:
    return _listed(same.rules) + (f"; also {_listed(same.further)}" if same.further else "")


def _listed(rules: Sequence[str]) -> str:
    more = f" and {len(rules) - _REASONS_SHOWN} more" if len(rules) > _REASONS_SHOWN else ""
    return ", ".join(rules[:_REASONS_SHOWN]) + more
