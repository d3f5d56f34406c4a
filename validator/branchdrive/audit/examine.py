"""Run the rules of a shard in order: structure, then attempts, then candidates and groups.

A rollout that breaks a structure rule is excluded from later rules by name; it never switches a
rule off for the others. Source: spec/07-rules.md#order.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from branchdrive.audit import rules as _bind_rules  # noqa: F401  (importing binds the rules)
from branchdrive.audit.check import GROUP_RULES, ROLLOUT_RULES, SHARD_RULES, Mask, RowCheck, SubjectCheck
from branchdrive.audit.finding import Finding, Sighting
from branchdrive.audit.funnel import Funnel, Standing, funnel_of, standings_of
from branchdrive.audit.rules.status import ATTEMPT_IS_COMPLETE
from branchdrive.audit.selection import Selection, select_candidates
from branchdrive.audit.tally import MAX_FINDINGS_PER_RULE, Tally, failure_text
from branchdrive.audit.view import ShardView, StreamView
from branchdrive.contract.catalogue import CATALOGUE

__all__ = ["VIEW_RULES", "Examination", "examine"]

VIEW_RULES = tuple(
    rule_id for rule_id in CATALOGUE if rule_id in SHARD_RULES or rule_id in ROLLOUT_RULES or rule_id in GROUP_RULES
)
"""Rules that read the rows of shards, in catalogue order."""


@dataclass
class Examination:
    """Outcome of the rules on one shard.

    Attributes:
        tallies: By rule.
        selection: Candidates of the groups.
        complies: Complete attempts that violate no rule ``[rollouts]``.
        standings: How far each group gets ``[groups]``.
        failed: Attempts that fail each rule on rows or attempts ``[rollouts]``.
        failed_groups: Groups that fail each rule on groups ``[groups]``.
    """

    tallies: dict[str, Tally] = field(default_factory=dict)
    selection: Selection = field(default_factory=lambda: Selection(np.zeros((0, 0), np.int64), np.zeros(0, np.int64)))
    complies: Mask = field(default_factory=lambda: np.zeros(0, bool))
    standings: list[Standing] = field(default_factory=list)
    failed: dict[str, Mask] = field(default_factory=dict)
    failed_groups: dict[str, Mask] = field(default_factory=dict)

    @property
    def funnel(self) -> Funnel:
        """Groups that reach each stage."""
        return funnel_of(self.standings)


@np.errstate(all="ignore")  # what overflows or is no number is found by the rules, not by warnings
def examine(view: ShardView, selected: Collection[str] | None = None) -> Examination:
    """Run the selected rules (all by default) on one shard."""
    result = Examination()
    for rule_id in VIEW_RULES:
        if selected is None or rule_id in selected:
            tally = result.tallies[rule_id] = Tally(rule_id)
            streams = CATALOGUE[rule_id].streams
            tally.is_claimed = not streams or any(name in view.descriptor.streams for name in streams)

    def run(rules: Iterable[str], judge: Callable[[str, Tally], None]) -> None:
        for rule_id in rules:
            tally = result.tallies.get(rule_id)
            if tally is None or not tally.is_claimed:
                continue
            try:
                judge(rule_id, tally)
            except MemoryError:
                raise
            except Exception:  # a failing rule is a bug of this tool and must not hide the other rules
                tally.errors.append(failure_text(f"{rule_id} on {view.file_prefix or 'memory'}"))

    in_order = [rule_id for rule_id in VIEW_RULES if rule_id in SHARD_RULES]
    run(in_order, lambda rule_id, tally: _judge_rows(view, rule_id, tally, result))
    broken = _any(result.failed.values(), view.num_rollouts)
    in_order = [rule_id for rule_id in VIEW_RULES if rule_id in ROLLOUT_RULES]

    def judge_attempts(rule_id: str, tally: Tally) -> None:
        subjects = ~broken if rule_id == ATTEMPT_IS_COMPLETE else view.complete & ~broken
        _judge_rollouts(view, rule_id, tally, result, subjects)

    run(in_order, judge_attempts)

    result.complies = view.complete & ~_any(result.failed.values(), view.num_rollouts)
    selection = result.selection = select_candidates(view, result.complies)
    touched = np.any(broken[selection.chosen] & (selection.chosen >= 0), axis=1)
    in_order = [rule_id for rule_id in VIEW_RULES if rule_id in GROUP_RULES]

    def judge_groups(rule_id: str, tally: Tally) -> None:
        check = GROUP_RULES[rule_id](view, selection, ~touched)
        result.failed_groups[rule_id] = check.bad
        _count_subjects(tally, check, lambda g: {"group_id": view.group_ids[g]})

    run(in_order, judge_groups)
    result.standings = standings_of(view, selection, result.failed, result.failed_groups)
    return result


def _any(masks: Iterable[Mask], size: int) -> Mask:
    merged = np.zeros(size, bool)
    for mask in masks:
        merged |= mask
    return merged


def _judge_rows(view: ShardView, rule_id: str, tally: Tally, result: Examination) -> None:
    failed = np.zeros(view.num_rollouts, bool)
    for check in SHARD_RULES[rule_id](view):
        tally.examined += check.examined
        tally.total += check.examined
        tally.num_findings += len(check.bad)
        if len(check.bad):
            owner = _owner(view, check)
            failed[owner[owner >= 0]] = True
            if len(tally.findings) < MAX_FINDINGS_PER_RULE:
                tally.keep(_row_findings(view, rule_id, check))
    if failed.any():
        result.failed[rule_id] = failed


def _owner(view: ShardView, check: RowCheck) -> np.ndarray:
    return check.bad if check.table == "rollouts" else view.stream(check.table).rollout[check.bad]


def _row_findings(view: ShardView, rule_id: str, check: RowCheck) -> Iterable[Finding]:
    """One finding per rollout, at its first violating row."""
    owner = _owner(view, check)
    # Rows without a known rollout stand for themselves.
    key = np.where(owner >= 0, owner, -1 - check.bad)
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    for place, rows in islice(sorted(zip(first, count, strict=True)), MAX_FINDINGS_PER_RULE):
        row = int(check.bad[place])
        expected, found = check.describe(row)
        yield Finding.of(rule_id, Sighting(expected, found, _row_location(view, check, row), int(rows)))


def _row_location(view: ShardView, check: RowCheck, row: int) -> dict[str, str | int]:
    location: dict[str, str | int] = {"table": check.table}
    if view.file_prefix:
        location = {"file": f"{view.file_prefix}/{check.table}.parquet", **location}
    if check.column:
        location["column"] = check.column
    table = view[check.table]
    rollout_id = table["rollout_id"][row]
    if rollout_id:
        location["rollout_id"] = str(rollout_id)
    if isinstance(table, StreamView):
        location["tick"] = int(table.tick[row])
        if "actor_id" in table:
            location["actor_id"] = int(table["actor_id"][row])
    return location


def _judge_rollouts(view: ShardView, rule_id: str, tally: Tally, result: Examination, subjects: Mask) -> None:
    excluded = _any((result.failed[r] for r in CATALOGUE[rule_id].requires if r in result.failed), view.num_rollouts)
    check = ROLLOUT_RULES[rule_id](view, subjects & ~excluded)
    if check.bad.any():
        result.failed[rule_id] = check.bad
    _count_subjects(
        tally,
        check,
        lambda i: {"group_id": str(view.rollouts["group_id"][i]), "rollout_id": view.rollout_ids[i]},
    )


def _count_subjects(tally: Tally, check: SubjectCheck, identity: Callable[[int], dict[str, str | int]]) -> None:
    tally.examined += int(check.examined.sum())
    tally.total += len(check.examined)
    bad = np.flatnonzero(check.bad)
    tally.num_findings += len(bad)
    for subject in bad[:MAX_FINDINGS_PER_RULE]:
        seen = check.describe(int(subject))
        location = {**identity(int(subject)), **seen.location}
        tally.keep([Finding.of(tally.rule_id, Sighting(seen.expected, seen.found, location, seen.count))])
