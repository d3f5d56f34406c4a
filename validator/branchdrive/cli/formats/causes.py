"""Causes in words: what to look at first, where it is, what may follow from it, and what to do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from branchdrive.cli.formats.where import place_text, with_short_digests
from branchdrive.contract.columns import TABLES
from branchdrive.contract.rule import RuleInfo
from branchdrive.contract.text import counted
from branchdrive.engine.cause import Cause, Extent, Following
from branchdrive.engine.finding import Finding
from branchdrive.engine.relation import SIBLINGS, repair_first
from branchdrive.engine.report import Report
from branchdrive.engine.tally import Tally
from branchdrive.engine.verdict import is_waived
from branchdrive.text.brief import brief

__all__ = ["CAUSES_HEAD", "CauseText", "cause_texts", "causes_text", "remedy_text", "violations"]

CAUSES_HEAD = "What to look at first"
"""Head of the summary."""

_PLACES_SHOWN = 4
_SHARDS_SHOWN = 3
_FOLLOWING_SHOWN = 6

_CHANGED = "BD-LAY-002"
"""The rule on files that are not those of the manifest."""

_ON_FOLDERS_TOO = ("BD-LAY-006", "BD-LAY-007", "BD-LAY-009")
"""Rules on files that examine folders as well, so that they count more than the files of the dataset."""

_ON_LISTED_FILES = (_CHANGED, "BD-LAY-003")
"""Rules on the files that the manifest lists, which are all but itself."""


class CauseText(NamedTuple):
    """A cause in words.

    Attributes:
        info: The rule.
        title: What does not hold.
        where: Shards, groups and attempts, or how many violations where it is about no single group.
        found: Where it fails first, what was expected and what was found, with the finding as far as it is kept, by
            column or by file.
        follows: What may follow from it, each as far as it does, which other causes are in its groups, and what is
            known of the files that they are in; may be empty.
        remedy: What to do.
    """

    info: RuleInfo
    title: str
    where: str
    found: tuple[tuple[str, Finding | None], ...]
    follows: str
    remedy: str


def cause_texts(report: Report) -> list[CauseText]:
    """The causes of a report that no waiver covers, those to look at first before others."""
    tallies = {tally.rule_id: tally for tally in report.tallies}
    causes = [cause for cause in report.causes.first if not is_waived(tallies[cause.rule_id])]
    changed = _changed_tables(tallies[_CHANGED])
    return [_text(cause, causes, tallies, changed) for cause in causes]


def _text(
    cause: Cause, causes: Sequence[Cause], tallies: dict[str, Tally], changed: Sequence[tuple[str, str]]
) -> CauseText:
    found: list[tuple[str, Finding | None]] = [(_found(finding), finding) for finding in cause.firsts[:_PLACES_SHOWN]]
    if cause.detail and cause.extents:
        found.append((f"{cause.extents[0].groups[0]}{cause.detail}", None))
    where = _extent(cause) or violations(tallies[cause.rule_id])
    if (left := len(cause.firsts) - len(found)) > 0:
        where += f", {counted(left, 'place')} of them not shown here"
    files = _faults_in(changed, causes) if cause.rule_id == _CHANGED else _files_of(cause, changed)
    follows = "; ".join(filter(None, (_follows(cause, tallies), _together(cause), files)))
    return CauseText(cause.info, cause.info.broken, where, tuple(found), follows, cause.info.remedy)


def _found(finding: Finding) -> str:
    (said,) = brief(f"expected {finding.expected}; found {finding.found}")
    place = place_text(finding)
    return with_short_digests(f"{place}: {said}" if place else said)


def _changed_tables(tally: Tally) -> list[tuple[str, str]]:
    """Shards and tables whose files are not those of the manifest, as far as findings are kept."""
    names = {table.file_name: name for name, table in TABLES.items()}
    paths = [str(finding.location.get("file", "")).split("/") for finding in tally.findings]
    return [(path[-2], names[path[-1]]) for path in paths if len(path) > 1 and path[-1] in names]


def _in_changed(cause: Cause, changed: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Those of changed tables that findings of a cause are in."""
    shards = {extent.shard for extent in cause.extents}
    tables = {finding.location.get("table") for finding in cause.firsts}
    return [(shard, table) for shard, table in changed if shard in shards and table in tables]


def _faults_in(changed: Sequence[tuple[str, str]], causes: Sequence[Cause]) -> str:
    """Which of the changed tables have other causes in them; empty where none has."""
    rules = [cause.rule_id for cause in causes if _in_changed(cause, changed)]
    if not rules:
        return ""
    with_faults = {each for cause in causes for each in _in_changed(cause, changed)}
    tables = _tables_text([each for each in changed if each in with_faults])
    return f"the faults of {', '.join(rules)} are in {tables}: these are not the files that the manifest lists"


def _files_of(cause: Cause, changed: Sequence[tuple[str, str]]) -> str:
    """That a cause is in files that are not those of the manifest; empty where that is not known."""
    if not (found := _in_changed(cause, changed)):
        return ""
    verb = "is not the file" if len(found) == 1 else "are not the files"
    return f"{_tables_text(found)} {verb} that the manifest lists ({_CHANGED})"


def _tables_text(changed: Sequence[tuple[str, str]]) -> str:
    by_shard: dict[str, list[str]] = {}
    for shard, table in changed:
        by_shard.setdefault(shard, []).append(table)
    parts = [f"{_joined(tables)} of {shard}" for shard, tables in [*by_shard.items()][:_SHARDS_SHOWN]]
    left = len(by_shard) - len(parts)
    return "; ".join(parts) + (f" and tables of {counted(left, 'more shard')}" if left else "")


def _joined(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def violations(tally: Tally) -> str:
    """How many subjects of a rule violate it, of how many; a dataset is one, whatever was compared to judge it."""
    found = counted(tally.num_findings, "violation")
    if tally.info.grain == "dataset":
        return found
    which = " and folders" if tally.rule_id in _ON_FOLDERS_TOO else ""
    which = " that the manifest lists" if tally.rule_id in _ON_LISTED_FILES else which
    return f"{found} in {counted(tally.examined, tally.info.grain)}{which}"


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
    return "; ".join(_following_texts(tally, following))


def _following_texts(tally: Tally, following: Following) -> Iterator[str]:
    explained, failed = following.num_explained, following.num_failed
    noun = "group" if tally.info.scope == "group" else "attempt"
    for is_sibling, verb in ((False, "may follow from"), (True, "may have the same cause as")):
        causes = [each for each in following.causes if (each[0] in SIBLINGS) == is_sibling]
        names = [rule_id for rule_id, _ in causes]
        if not causes:
            continue
        if explained is None or all(number == failed for _, number in causes):
            yield f"{verb} {', '.join(names)}: look there first"
            continue
        (first, number), *others = causes
        parts = [f"{first} ({number:,} of {counted(failed, noun)})", *(f"{name} ({count:,})" for name, count in others)]
        yield f"{verb} {', '.join(parts)}: look there first"
    if explained is not None and (left := failed - explained):
        yield f"{left:,} {'does' if left == 1 else 'do'} not"


def remedy_text(tally: Tally, report: Report) -> str:
    """What to do about a rule that fails: its remedy, as far as others do not explain that."""
    following = report.causes.following.get(tally.rule_id)
    if following is None:
        return tally.info.remedy
    first = repair_first(tally.rule_id, [rule_id for rule_id, _ in following.causes])
    if following.num_explained is None or following.num_explained == following.num_failed:
        return first
    return f"{first} Of the others: {tally.info.remedy}"
