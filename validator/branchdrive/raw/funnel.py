"""The funnel: how many branch groups get how far, and which rules cost the rest.

Stages: discovered; bank (exact bank); controls (controls valid); integrity (integrity-complete);
eligibility (structurally eligible). A group leaves at the first stage that it fails.
Source: paper, "Collection Integrity, Replay Fidelity, and Leakage"; spec/07-rules.md#funnel.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from branchdrive.contract.mismatch import Mask
from branchdrive.contract.rule import CATALOGUE
from branchdrive.raw.canonical_choice import Selection
from branchdrive.raw.shard_view import ShardView

__all__ = ["LACKS", "STAGES", "Funnel", "GroupOutcome", "funnel_of", "group_outcomes"]

STAGES = {
    "discovered": "Groups discovered",
    "bank": "Exact bank",
    "controls": "Controls valid",
    "integrity": "Integrity-complete",
    "eligibility": "Structurally eligible",
}
"""Stages in order, with their titles."""

LACKS = {
    "bank": "no exact bank",
    "controls": "controls not valid",
    "integrity": "not integrity-complete",
    "eligibility": "not structurally eligible",
}
"""What a group is that is lost at a stage."""


@dataclass
class Funnel:
    """Groups lost at each stage and the rules that they fail there; funnels of shards add up.

    Attributes:
        outcomes: How far each group gets, in the order of the shards and of the groups in them.
    """

    discovered: int = 0
    lost: Counter[str] = field(default_factory=Counter)
    reasons: dict[str, Counter[str]] = field(default_factory=lambda: {stage: Counter() for stage in STAGES})
    outcomes: list[GroupOutcome] = field(default_factory=list)

    def add(self, other: Funnel) -> None:
        """Merge the funnel of another part of the dataset."""
        self.discovered += other.discovered
        self.lost.update(other.lost)
        for stage, counts in other.reasons.items():
            self.reasons[stage].update(counts)
        self.outcomes += other.outcomes

    @property
    def groups(self) -> dict[str, int]:
        """Groups that reach each stage."""
        left, reached = self.discovered, {}
        for stage in STAGES:
            left -= self.lost[stage]
            reached[stage] = left
        return reached

    @property
    def qualified(self) -> int:
        """Groups that pass every stage."""
        return self.groups["eligibility"]

    def to_json(self) -> dict[str, Any]:
        """The funnel as the report schema has it."""
        reached = self.groups
        return {
            "stages": [
                {
                    "name": stage,
                    "title": title,
                    "groups": reached[stage],
                    "lost": self.lost[stage],
                    "reasons": dict(sorted(self.reasons[stage].items())),
                }
                for stage, title in STAGES.items()
            ]
        }


@dataclass(frozen=True, slots=True)
class GroupOutcome:
    """How far one group gets.

    Attributes:
        group_id: The group.
        is_branched: Whether an attempt of it has a branch; a seed without one is a drive on which nothing happened.
        lost_at: Stage at which it is lost; ``None`` if none.
        rules: Rules that it fails there.
        failed: Every rule that it or attempts of it fail, with how many attempts that are, 0 where the rule is on
            groups; attempts that stand for no candidate count too.
        follows: Rules that other rules may be why attempts of it fail, each with those that nothing explains in turn,
            and how many attempts that are.
        tables: Tables that the first finding of rules in it is in, or in another group where it is not kept.
        detail: What was expected and found where it first fails the first of `rules`, in words; empty if unknown.
        hint: What findings of several rules together say of it, in words; empty where they say nothing.
    """

    group_id: str
    is_branched: bool = True
    lost_at: str | None = None
    rules: tuple[str, ...] = ()
    failed: tuple[tuple[str, int], ...] = ()
    follows: tuple[tuple[str, tuple[str, ...], int], ...] = ()
    tables: tuple[tuple[str, str], ...] = ()
    detail: str = ""
    hint: str = ""

    @property
    def is_integrity_complete(self) -> bool:
        """Whether the group reaches the stage `integrity`."""
        return self.lost_at in (None, "eligibility")


def group_outcomes(
    view: ShardView, selection: Selection, failed: dict[str, Mask], failed_groups: dict[str, Mask]
) -> list[GroupOutcome]:
    """How far every group of a shard gets.

    Args:
        view: The shard.
        selection: Its candidates.
        failed: Attempts that fail each structure or rollout rule ``[rollouts]``.
        failed_groups: Groups that fail each group rule ``[groups]``.
    """
    by_stage: dict[str, dict[str, Mask]] = {stage: {} for stage in STAGES}
    for rule_id, groups in failed_groups.items():
        by_stage[CATALOGUE[rule_id].stage or "bank"][rule_id] = groups
    members = selection.chosen >= 0
    for rule_id, rollouts in failed.items():
        groups = np.zeros(len(view.group_ids), bool)
        groups[np.flatnonzero((rollouts[selection.chosen] & members).any(axis=1))] = True
        by_stage[CATALOGUE[rule_id].stage or "bank"][rule_id] = groups
    is_branched = np.isin(np.arange(len(view.group_ids)), view.group[view.branched])
    named = zip(view.group_ids, is_branched.tolist(), strict=True)
    outcomes = [GroupOutcome(str(group_id), branched) for group_id, branched in named]
    if view.descriptor.is_of_drives:  # which have no bank, and are in no funnel
        return [replace(outcome, lost_at="bank") for outcome in outcomes]
    for stage, rules in by_stage.items():
        for g, outcome in enumerate(outcomes):
            reasons = tuple(rule_id for rule_id, groups in rules.items() if groups[g])
            if reasons and outcome.lost_at is None:
                outcomes[g] = replace(outcome, lost_at=stage, rules=reasons)
    return outcomes


def funnel_of(outcomes: list[GroupOutcome]) -> Funnel:
    """Funnel of groups."""
    funnel = Funnel(discovered=len(outcomes), outcomes=list(outcomes))
    for outcome in outcomes:
        if outcome.lost_at is not None:
            funnel.lost[outcome.lost_at] += 1
            funnel.reasons[outcome.lost_at].update(outcome.rules)
    return funnel
