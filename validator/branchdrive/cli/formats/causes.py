"""Causes in words: what to look at first, where it is, what may follow from it, and what to do."""

from __future__ import annotations

from typing import NamedTuple

from branchdrive.contract.rule import RuleInfo
from branchdrive.contract.text import counted
from branchdrive.engine.cause import Cause, Extent
from branchdrive.engine.finding import Finding
from branchdrive.engine.report import Report
from branchdrive.engine.tally import Tally
from branchdrive.engine.verdict import is_waived
from branchdrive.text.brief import brief

__all__ = ["CAUSES_HEAD", "CauseText", "cause_texts", "causes_text"]

CAUSES_HEAD = "What to look at first"
"""Head of the summary."""

_COLUMNS_SHOWN = 3
_SHARDS_SHOWN = 3
_FOLLOWING_SHOWN = 6


class CauseText(NamedTuple):
    """A cause in words.

    Attributes:
        info: The rule.
        title: Its title, with the columns at fault.
        where: Shards, groups and attempts, or how many violations where it is about no single group.
        found: What was expected and found where it first fails; empty where that is not kept.
        follows: What may follow from it, each as far as it does, and which other causes are in its groups; may be
            empty.
        remedy: What to do.
    """

    info: RuleInfo
    title: str
    where: str
    found: str
    follows: str
    remedy: str


def cause_texts(report: Report) -> list[CauseText]:
    """The causes of a report that no waiver covers, those to look at first before others."""
    tallies = {tally.rule_id: tally for tally in report.tallies}
    return [_text(cause, tallies) for cause in report.causes.first if not is_waived(tallies[cause.rule_id])]


def _text(cause: Cause, tallies: dict[str, Tally]) -> CauseText:
    columns = cause.columns[:_COLUMNS_SHOWN]
    more = f" and {len(cause.columns) - len(columns)} more" if len(cause.columns) > len(columns) else ""
    title = cause.info.title + (f", in {', '.join(columns)}{more}" if columns else "")
    first = cause.first
    found = ""
    if first is not None:
        (said,) = brief(f"expected {first.expected}; found {first.found}")
        found = f"{_place(first)}{said}"
    where = _extent(cause) or _violations(tallies[cause.rule_id])
    follows = "; ".join(filter(None, (_follows(cause, tallies), _together(cause))))
    return CauseText(cause.info, title, where, found, follows, cause.info.remedy)


def _place(finding: Finding) -> str:
    """Group and tick of a finding, to stand before what was found there."""
    tick = f", tick {finding.location['tick']}" if "tick" in finding.location else ""
    return "" if finding.group_id is None else f"{finding.group_id}{tick}: "


def _violations(tally: Tally) -> str:
    first = tally.findings[0].location if tally.findings else {}
    place = first.get("file", "")
    return counted(tally.num_findings, "violation") + (f", the first in {place}" if place else "")


def _extent(cause: Cause) -> str:
    """Shards, groups and attempts of a cause; empty where it is about no single group."""
    if not cause.num_groups:
        return ""
    attempts = f", {counted(cause.num_attempts, 'attempt')}" if cause.num_attempts else ""
    if cause.is_everywhere and cause.of_shards > 1:
        return f"the whole dataset: {counted(cause.num_groups, 'group')} of all {cause.of_shards:,} shards{attempts}"
    parts = [_of_shard(extent) for extent in cause.extents[:_SHARDS_SHOWN]]
    if cause.num_shards > len(parts):
        num_groups = cause.num_groups - sum(extent.num_groups for extent in cause.extents[:_SHARDS_SHOWN])
        parts.append(f"{counted(num_groups, 'group')} of {counted(cause.num_shards - len(parts), 'more shard')}")
    return "; ".join(parts)


def _of_shard(extent: Extent) -> str:
    attempts = ""
    if extent.num_attempts:
        attempts = f", {extent.num_attempts:,} of {counted(extent.of_attempts, 'attempt')}"
    if extent.is_whole and extent.num_groups > 1:
        groups = f"{extent.groups[0]} to {extent.last} ({counted(extent.num_groups, 'group')})"
        return f"all of {extent.shard}: {groups}{attempts}"
    left = extent.num_groups - len(extent.groups)
    named = ", ".join(extent.groups) + (f" and {left:,} more" if left else "")
    return f"{extent.num_groups:,} of {counted(extent.of_groups, 'group')} of {extent.shard}: {named}{attempts}"


def _follows(cause: Cause, tallies: dict[str, Tally]) -> str:
    parts = []
    for consequence in cause.consequences[:_FOLLOWING_SHOWN]:
        found, tally = consequence.num_attempts or consequence.num_groups, tallies[consequence.rule_id]
        noun = "attempt" if consequence.num_attempts else "group"
        # Rules on rows count rows, whatever attempts these are of.
        is_part = bool(found) and tally.info.grain in ("rollout", "group") and found < tally.num_findings
        of_all = f"{found:,} of {counted(tally.num_findings, noun)}" if is_part else counted(found, noun)
        parts.append(f"{consequence.rule_id} ({of_all})" if found else consequence.rule_id)
    if not parts:
        return ""
    left = len(cause.consequences) - len(parts)
    return f"may explain {', '.join(parts)}" + (f" and {counted(left, 'more rule')}" if left else "")


def _together(cause: Cause) -> str:
    if not cause.together:
        return ""
    where = "its group fails" if cause.num_groups == 1 else "all of its groups fail"
    return f"{where} {', '.join(cause.together)} too"


def causes_text(tally: Tally, report: Report) -> str:
    """How far the failure of a rule may follow from others, in words; empty where it is a cause alone."""
    following = report.causes.following.get(tally.rule_id)
    if following is None:
        return ""
    explained, failed = following.num_explained, following.num_failed
    names = [rule_id for rule_id, _ in following.causes]
    if explained is None or all(number == failed for _, number in following.causes):
        return f"may follow from {', '.join(names)}: look there first"
    noun = "group" if tally.info.scope == "group" else "attempt"
    (first, number), *others = following.causes
    parts = [f"{first} ({number:,} of {counted(failed, noun)})", *(f"{name} ({count:,})" for name, count in others)]
    left = failed - explained
    rest = f"; {left:,} {'does' if left == 1 else 'do'} not" if left else ""
    return f"may follow from {', '.join(parts)}: look there first{rest}"
