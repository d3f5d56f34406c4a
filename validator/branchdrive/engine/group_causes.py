"""Causes in one group, and those that are on the dataset as a whole.

Source: spec/07-rules.md#report.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace

from branchdrive.contract.rule import cause_order
from branchdrive.engine.relation import POSSIBLE
from branchdrive.engine.tally import Tally
from branchdrive.raw.funnel import GroupOutcome

__all__ = ["DatasetCauses", "GroupCauses", "link_to_dataset"]


class DatasetCauses:
    """Which failed rules on the dataset may be why others fail.

    Args:
        failed: Tallies of the rules that fail.
    """

    def __init__(self, failed: Mapping[str, Tally]) -> None:
        dataset = {rule_id for rule_id, tally in failed.items() if tally.info.scope == "dataset"}
        # What says that nearly all attempts fail a rule follows from it, and explains nothing itself.
        self._named = {rule_id: _named(failed[rule_id], failed) for rule_id in dataset}
        self._dataset = {rule_id for rule_id in dataset if not self._named[rule_id]}
        self._failed = failed

    def causes_of(self, rule_id: str) -> tuple[str, ...]:
        """Rules on the dataset that may be why a rule fails, in whichever group."""
        return tuple(other for other in POSSIBLE.get(rule_id, ()) if other in self._dataset)

    def roots_of(self, rule_id: str) -> tuple[str, ...]:
        """Causes of a rule that is about no single group."""
        roots, seen, waiting = set(), {rule_id}, self._parents(rule_id)
        while waiting:
            other = waiting.pop()
            if other in seen:
                continue
            seen.add(other)
            parents = self._parents(other)
            waiting += parents
            if not parents:
                roots.add(other)
        return tuple(sorted(roots, key=cause_order))

    def _parents(self, rule_id: str) -> list[str]:
        possible = (*POSSIBLE.get(rule_id, ()), *self._named.get(rule_id, ()))
        return [other for other in possible if other in self._failed and not self._named.get(other)]


def _named(tally: Tally, failed: Iterable[str]) -> tuple[str, ...]:
    """Failed rules of which all findings of a rule of the dataset say that nearly all attempts fail them."""
    named = {finding.expected[:10] for finding in tally.findings}
    return tuple(sorted(named)) if named and named <= {*failed} else ()


def link_to_dataset(tallies: Mapping[str, Tally]) -> None:
    """Say in findings of rules on rows, attempts and groups which rules on the whole dataset may be why."""
    relation = DatasetCauses({rule_id: tally for rule_id, tally in tallies.items() if tally.num_findings})
    for rule_id, tally in tallies.items():
        if tally.findings and tally.info.scope != "dataset" and (causes := relation.causes_of(rule_id)):
            tally.findings = [
                replace(finding, follows=tuple(sorted({*causes, *finding.follows}, key=cause_order)))
                for finding in tally.findings
            ]


class GroupCauses:
    """Causes in one group.

    Args:
        outcome: What became of it.
        known: Rules that fail and are asked for.
        relation: Rules on the dataset that fail.

    Attributes:
        failed: Rules that it fails, with its attempts that do; 0 for a rule on groups.
        causes: Those of them that nothing explains, each with the attempts of which that is so.
        following: The others, each with its causes, and the attempts in which they may be why.
    """

    def __init__(self, outcome: GroupOutcome, known: Iterable[str], relation: DatasetCauses) -> None:
        self._relation = relation
        self.failed = {rule_id: number for rule_id, number in outcome.failed if rule_id in known}
        self._parts: dict[str, list[tuple[tuple[str, ...], int]]] = {}
        for rule_id, roots, number in outcome.follows:
            if known_roots := tuple(root for root in roots if root in self.failed):
                self._parts.setdefault(rule_id, []).append((known_roots, number))
        self.causes = {}
        for rule_id, number in self.failed.items():
            left = number - sum(part for _, part in self._parts.get(rule_id, ()))
            if (left > 0 or not number) and not relation.causes_of(rule_id):
                self.causes[rule_id] = left
        self.following: dict[str, Counter[str]] = {}
        for rule_id, number in self.failed.items():
            of_dataset = relation.causes_of(rule_id)
            parts = [*self._parts.get(rule_id, ()), *([(of_dataset, number)] if of_dataset else [])]
            for roots, part in parts:
                for root in set[str]().union(*(self._ends(root, frozenset()) for root in roots)) - {rule_id}:
                    numbers = self.following.setdefault(rule_id, Counter())
                    numbers[root] = min(numbers[root] + part, number)

    def _ends(self, rule_id: str, seen: frozenset[str]) -> set[str]:
        """The causes that a rule leads to: itself where it is one, and what it follows from in other attempts."""
        if rule_id in self.causes or rule_id not in self.failed:
            return {rule_id}
        roots = {*self._relation.causes_of(rule_id)}.union(*(roots for roots, _ in self._parts.get(rule_id, ())))
        return set[str]().union(*(self._ends(root, seen | {rule_id}) for root in roots - seen))
