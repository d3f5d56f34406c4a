"""Run the rules of a shard in order: structure, then attempts, then candidates and groups.

A rollout that breaks a structure rule is excluded from later rules by name; it never switches a
rule off for the others. Source: spec/07-rules.md#order.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from branchdrive.contract.columns import TABLES
from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.rule import CATALOGUE, RULES, rules_of
from branchdrive.engine import rules as _bind_rules  # noqa: F401  (importing binds the rules)
from branchdrive.engine.finding import Finding
from branchdrive.engine.group_failures import GroupFailures
from branchdrive.engine.judge import judge
from branchdrive.engine.relation import Roots
from branchdrive.engine.tally import Tally
from branchdrive.raw.canonical_choice import select_candidates
from branchdrive.raw.examination import Examination
from branchdrive.raw.funnel import group_outcomes
from branchdrive.raw.rules.status import ATTEMPT_IS_COMPLETE
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import StreamView

__all__ = ["VIEW_RULES", "examine"]

VIEW_RULES = rules_of("rows", "rollout", "group")
"""Rules that read the rows of shards, in catalogue order."""


@np.errstate(all="ignore")  # what overflows or is not a number is found by the rules, not by warnings
def examine(
    view: ShardView,
    selected: Collection[str] | None = None,
    *,
    repeated_rollouts: Collection[str] = (),
    scattered_groups: Collection[str] = (),
    failures: GroupFailures | None = None,
) -> tuple[dict[str, Tally], Examination]:
    """Run the rules of a shard in order.

    Args:
        view: The shard.
        selected: Rules to run; all by default.
        repeated_rollouts: Attempts whose identity occurs more than once in the dataset.
        scattered_groups: Groups that lie in other shards too.
        failures: Failures of the groups of the view, which are added to; for callers who look at them.

    Returns:
        Totals by rule, and what became of the attempts of the shard.
    """
    result, tallies = Examination(), {}
    for rule_id in VIEW_RULES:
        if selected is None or rule_id in selected:
            tallies[rule_id] = Tally(rule_id, is_claimed=CATALOGUE[rule_id].is_about(view.descriptor.streams))
    place = view.file_prefix or "memory"
    claimed = {rule_id: tally for rule_id, tally in tallies.items() if tally.is_claimed}
    in_scope = {scope: [r for r in rules_of(scope) if r in claimed] for scope in ("rows", "rollout", "group")}

    failures = GroupFailures(view) if failures is None else failures

    def note_rows(rule_id: str, check: Check) -> None:
        failures.note_first(rule_id, check, _owner(view, check), partial(_of_rows, view))

    def note_rollouts(rule_id: str, check: Check) -> None:
        failures.note_first(rule_id, check, check.bad, partial(_of_rollouts, view))

    def note_groups(rule_id: str, check: Check) -> None:
        failures.note_first_of_groups(rule_id, check, partial(_of_groups, view))

    for rule_id in in_scope["rows"]:
        each = partial(note_rows, rule_id) if _excludes(rule_id) else None
        bad = judge(claimed[rule_id], partial(RULES[rule_id], view), partial(_of_rows, view), place=place, each=each)
        failed = _any((_rollouts(view, check) for check in bad), view.num_rollouts)
        failures.note_attempts(rule_id, failed)
        if failed.any() and _excludes(rule_id):
            result.failed[rule_id] = failed
    for rule_id, ids, refused in (
        ("BD-KEY-001", view.rollout_ids, repeated_rollouts),
        ("BD-KEY-003", view.rollouts["group_id"], scattered_groups),
    ):
        if refused:
            result.failed[rule_id] = np.array([name in refused for name in ids], bool)
            failures.note_attempts(rule_id, result.failed[rule_id])
    broken = result.broken = _any(result.failed.values(), view.num_rollouts)

    for rule_id in in_scope["rollout"]:
        subjects = ~broken if rule_id == ATTEMPT_IS_COMPLETE else view.complete & ~broken
        requires = (result.failed[other] for other in CATALOGUE[rule_id].requires if other in result.failed)
        subjects = subjects & ~_any(requires, view.num_rollouts)
        each = partial(note_rollouts, rule_id) if _excludes(rule_id) else None
        judged = partial(RULES[rule_id], view, subjects)
        bad = judge(claimed[rule_id], judged, partial(_of_rollouts, view), place=place, each=each)
        failed = _any((_marked(check.bad, view.num_rollouts) for check in bad), view.num_rollouts)
        failures.note_attempts(rule_id, failed, [stretch for check in bad for stretch in check.stretches])
        if bad and _excludes(rule_id):
            result.failed[rule_id] = failed

    result.complies = view.complete & ~_any(result.failed.values(), view.num_rollouts)
    selection = result.selection = select_candidates(view, result.complies)
    num_groups = len(view.group_ids)
    touched = np.any(broken[selection.chosen] & (selection.chosen >= 0), axis=1)
    touched |= np.array([group_id in scattered_groups for group_id in view.group_ids], bool)
    for rule_id in in_scope["group"]:
        tally = claimed[rule_id]
        each = partial(note_groups, rule_id) if CATALOGUE[rule_id].stage else None
        judged = partial(RULES[rule_id], view, selection, ~touched)
        bad = judge(tally, judged, partial(_of_groups, view), place=place, each=each)
        failed = _any((_marked(check.bad, num_groups) for check in bad), num_groups)
        failures.note_groups(rule_id, failed)
        if not tally.errors and CATALOGUE[rule_id].stage:
            result.failed_groups[rule_id] = failed
    roots = failures.roots()
    result.outcomes = failures.added_to(group_outcomes(view, selection, result.failed, result.failed_groups), roots)
    for tally in tallies.values():
        tally.findings = [_linked(finding, view, roots) for finding in tally.findings]
    return tallies, result


def _linked(finding: Finding, view: ShardView, roots: Sequence[Roots]) -> Finding:
    """A finding with the rules that may be why, as far as it is about an attempt."""
    attempt = view.find_rollout(str(finding.location.get("rollout_id", "")))
    follows = () if attempt is None else roots[attempt].get(finding.rule, ())
    return replace(finding, follows=follows) if follows else finding


def _excludes(rule_id: str) -> bool:
    """Whether an attempt that fails the rule is kept from later ones; others judge what the dataset says of it."""
    return CATALOGUE[rule_id].kind in ("structure", "qualification")


def _any(masks: Iterable[Mask], size: int) -> Mask:
    merged = np.zeros(size, bool)
    for mask in masks:
        merged |= mask
    return merged


def _marked(subjects: np.ndarray, size: int) -> Mask:
    mask = np.zeros(size, bool)
    mask[subjects] = True
    return mask


def _owner(view: ShardView, check: Check) -> np.ndarray:
    """Attempt of each bad row; -1 where it is unknown, or the row is of none."""
    if check.table == "rollouts":
        return check.bad
    table = view[str(check.table)]
    return table.rollout[check.bad] if isinstance(table, StreamView) else np.full(len(check.bad), -1)


def _rollouts(view: ShardView, check: Check) -> Mask:
    owner = _owner(view, check)
    return _marked(owner[owner >= 0], view.num_rollouts)


def _of_rows(view: ShardView, check: Check) -> Iterator[Mismatch]:
    """One mismatch for each rollout, at its first bad row."""
    owner, table = _owner(view, check), view[str(check.table)]
    # Rows without a known rollout stand for themselves.
    key = np.where(owner >= 0, owner, -1 - check.bad)
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    _, back = np.unique(key[::-1], return_index=True)
    for place, rows, last in sorted(zip(first.tolist(), count.tolist(), (len(key) - 1 - back).tolist(), strict=True)):
        row, attempt = int(check.bad[place]), int(owner[place])
        found = check.mismatch(row)
        where = _row_location(view, str(check.table), row, found.location)
        group_id = str(view.rollouts["group_id"][attempt]) if attempt >= 0 else None
        last_tick = int(table["tick"][check.bad[last]]) if isinstance(table, StreamView) else None
        yield Mismatch(where, found.expected, found.found, rows, group_id, last_tick, _branch_tick(view, attempt))


def _row_location(view: ShardView, name: str, row: int, found: Location) -> Location:
    location: Location = {"table": name}
    if view.file_prefix:
        location = {"file": f"{view.file_prefix}/{name}.parquet", **location}
    location |= found
    table = view[name]
    for column in ("rollout_id", "town", "element_id", "camera"):
        if column in TABLES[name].key and table[column][row]:
            location[column] = str(table[column][row])
    if isinstance(table, StreamView):
        location["tick"] = int(table["tick"][row])
        if "actor_id" in table:
            location["actor_id"] = int(table["actor_id"][row])
    return location


def _of_rollouts(view: ShardView, check: Check) -> Iterator[Mismatch]:
    for i in check.bad.tolist():
        identity: Location = {"group_id": str(view.rollouts["group_id"][i]), "rollout_id": view.rollout_ids[i]}
        found = check.mismatch(i)
        ticks = (stretch.last_tick(i, found.location) for stretch in check.stretches)
        last_tick = next((tick for tick in ticks if tick is not None), None)
        yield replace(found.within(identity), last_tick=last_tick, branch_tick=_branch_tick(view, i))


def _branch_tick(view: ShardView, attempt: int) -> int | None:
    return int(view.branch_tick[attempt]) if attempt >= 0 and view.branched[attempt] else None


def _of_groups(view: ShardView, check: Check) -> Iterator[Mismatch]:
    for group in check.bad.tolist():
        yield check.mismatch(group).within({"group_id": view.group_ids[group]})
