"""Causes and what may follow from them: which rules to look at first, where they fail, and how far they explain others.

What is recomputed from a wrong column differs from what is recorded, and what is expected there is the wrong one. So
a rule that recomputes may fail in an attempt because of another rule that fails there, or in the dataset as a whole;
one that nothing explains is a cause. See `branchdrive.engine.relation`. Source: spec/07-rules.md#report.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

from branchdrive.contract.rule import CATALOGUE, RuleInfo, cause_order
from branchdrive.contract.text import printable
from branchdrive.engine.finding import Finding
from branchdrive.engine.group_causes import DatasetCauses, GroupCauses
from branchdrive.engine.tally import Tally
from branchdrive.raw.funnel import GroupOutcome

if TYPE_CHECKING:
    from branchdrive.engine.shard import ShardResult

__all__ = ["NO_CAUSES", "Cause", "Causes", "Consequence", "Extent", "Following", "find_causes"]

MAX_NAMED_GROUPS = 5
"""Groups of a shard that an extent names."""

MAX_SHARDS = 100
"""Shards that a cause lists."""

_BESIDE = ("BD-LAY-009",)
"""Rules on what lies beside a dataset, which explain nothing in it."""


@dataclass(frozen=True)
class Extent:
    """Where in a shard a cause is.

    Attributes:
        shard: Name of the shard.
        groups: The first groups that fail the rule and where nothing explains that, safe to print.
        last: The last of them.
        num_groups: How many.
        of_groups: Groups of the shard.
        num_attempts: Attempts that fail it in these groups; 0 for a rule on groups.
        of_attempts: Attempts of the shard.
    """

    shard: str
    groups: tuple[str, ...]
    last: str
    num_groups: int
    of_groups: int
    num_attempts: int
    of_attempts: int

    @property
    def is_whole(self) -> bool:
        """Whether every group of the shard is one of these."""
        return self.num_groups == self.of_groups

    def to_json(self) -> dict[str, Any]:
        """As the report schema has it."""
        return {
            "shard": self.shard,
            "groups": list(self.groups),
            "num_groups": self.num_groups,
            "of_groups": self.of_groups,
            "num_attempts": self.num_attempts,
            "of_attempts": self.of_attempts,
        }


@dataclass(frozen=True)
class Consequence:
    """A rule that may fail because of a cause, as far as it does where the cause is.

    Attributes:
        rule_id: The rule.
        num_groups: Groups in which it fails and the cause may be why; 0 where it is not about single ones.
        num_attempts: Attempts of them that fail it; 0 for a rule on groups.
    """

    rule_id: str
    num_groups: int
    num_attempts: int

    def to_json(self) -> dict[str, Any]:
        """As the report schema has it."""
        return {"rule": self.rule_id, "num_groups": self.num_groups, "num_attempts": self.num_attempts}


@dataclass(frozen=True)
class Cause:
    """A rule that fails where no other explains it; in rows of one table, as other tables have other faults.

    Attributes:
        rule_id: The rule.
        columns: Columns that its kept findings there name, sorted.
        firsts: Kept findings there, the first of each table and column, or of each file.
        extents: Shards with groups where it is, in order, at most `MAX_SHARDS`; none where it is not about groups.
        num_shards: Shards with groups where it is.
        of_shards: Shards of the dataset.
        num_groups: Groups where it is.
        num_attempts: Attempts that fail it there; 0 for a rule on groups.
        is_everywhere: Whether it is in every group of the dataset.
        consequences: What may follow from it, causes before their consequences.
        together: Other causes that are in all of its groups.
        detail: Of the first of its groups, column, and what was expected and found, where no finding is kept; may be
            empty.
    """

    rule_id: str
    columns: tuple[str, ...] = ()
    firsts: tuple[Finding, ...] = ()
    extents: tuple[Extent, ...] = ()
    num_shards: int = 0
    of_shards: int = 0
    num_groups: int = 0
    num_attempts: int = 0
    is_everywhere: bool = False
    consequences: tuple[Consequence, ...] = ()
    together: tuple[str, ...] = ()
    detail: str = ""

    @property
    def info(self) -> RuleInfo:
        """The rule's catalogue entry."""
        return CATALOGUE[self.rule_id]

    @property
    def first(self) -> Finding | None:
        """The first kept finding there; ``None`` where none is kept."""
        return self.firsts[0] if self.firsts else None

    def to_json(self) -> dict[str, Any]:
        """As the report schema has it."""
        return {
            "rule": self.rule_id,
            "title": self.info.title,
            "columns": list(self.columns),
            "expected": None if self.first is None else self.first.expected,
            "found": None if self.first is None else self.first.found,
            "num_shards": self.num_shards,
            "num_groups": self.num_groups,
            "num_attempts": self.num_attempts,
            "shards": [extent.to_json() for extent in self.extents],
            "consequences": [consequence.to_json() for consequence in self.consequences],
            "together": list(self.together),
            "remedy": self.info.remedy,
        }


@dataclass(frozen=True)
class Following:
    """How far the failure of a rule may follow from causes.

    Attributes:
        causes: The causes, first causes first, each with the attempts, or groups for a rule on groups, that fail it
            where it is; 0 where the rule is not about single groups.
        num_explained: Attempts, or groups for a rule on groups, that fail it where one of them is; ``None`` where the
            rule, or a cause of all of it, is not about single groups.
        num_failed: Attempts or groups that fail it.
    """

    causes: tuple[tuple[str, int], ...]
    num_explained: int | None
    num_failed: int


@dataclass(frozen=True)
class Causes:
    """What to look at first, and what may follow from it.

    Attributes:
        first: The causes: of the dataset as a whole, then by the number of groups where they are.
        following: Rules that may fail because of others.
    """

    first: tuple[Cause, ...] = ()
    following: Mapping[str, Following] = field(default_factory=dict)

    def to_json(self) -> list[dict[str, Any]]:
        """As the report schema has it."""
        return [cause.to_json() for cause in self.first]


NO_CAUSES = Causes()


@dataclass
class _Totals:
    """What a pass over the groups adds up for one rule and table where nothing explains it."""

    extents: list[Extent] = field(default_factory=list)
    num_shards: int = 0
    num_groups: int = 0
    num_attempts: int = 0
    names: set[str] = field(default_factory=set)  # of its groups those that kept findings of the rule are about
    together: set[str] | None = None
    groups_of: Counter[str] = field(default_factory=Counter)
    attempts_of: Counter[str] = field(default_factory=Counter)
    detail: str = ""


_Key: TypeAlias = tuple[str, str]
"""A rule, and the table that it first fails in in a group; empty where that is not known."""


def find_causes(tallies: Mapping[str, Tally], shards: Sequence[ShardResult]) -> Causes:
    """Causes of the rules that fail, by the groups in which they do.

    Args:
        tallies: One per rule, over the whole dataset.
        shards: What became of every shard.
    """
    failed = {rule_id: tally for rule_id, tally in tallies.items() if tally.num_findings}
    found = _Search(failed)
    for shard in shards:
        found.add_shard(shard)
    for rule_id in failed:
        if not found.counted[rule_id]:
            found.add_rule_of_dataset(rule_id)
    num_groups = sum(len(shard.funnel.outcomes) for shard in shards)
    first = [_cause(key, failed[key[0]], totals, len(shards), num_groups) for key, totals in found.causes.items()]
    return Causes(tuple(sorted(first, key=_cause_place)), found.following())


class _Search:
    """Causes and what follows from them, added up over groups.

    Args:
        failed: Tallies of the rules that fail.
    """

    def __init__(self, failed: Mapping[str, Tally]) -> None:
        self._failed = failed
        self._named = {rule_id: {one.group_id for one in tally.findings} for rule_id, tally in failed.items()}
        self._relation = DatasetCauses(failed)
        self.causes: dict[_Key, _Totals] = {}
        self.counted: Counter[str] = Counter()
        self._explained: Counter[str] = Counter()
        self._following: dict[str, Counter[str]] = {}

    def add_shard(self, shard: ShardResult) -> None:
        """Add the groups of a shard."""
        found: dict[_Key, list[tuple[str, int]]] = {}
        for outcome in (outcome for outcome in shard.funnel.outcomes if outcome.failed):
            for key, number in self._add_group(outcome).items():
                found.setdefault(key, []).append((printable(outcome.group_id[:128]), number))
        for key, groups in found.items():
            _add_extent(self.causes[key], shard, groups)
            self.causes[key].names.update(name for name, _ in groups if name in self._named[key[0]])

    def _add_group(self, outcome: GroupOutcome) -> dict[_Key, int]:
        """Add the rules that one group fails; its causes, each with the attempts that nothing explains."""
        group = GroupCauses(outcome, self._failed, self._relation)
        here, tables = group.causes, dict(outcome.tables)
        for rule_id in here:
            totals = self.causes.setdefault((rule_id, tables.get(rule_id, "")), _Totals())
            if outcome.rules and rule_id == min(outcome.rules, key=cause_order):
                totals.detail = totals.detail or outcome.detail
            others = {*here} - {rule_id}
            totals.together = others if totals.together is None else totals.together & others
        for rule_id, number in group.failed.items():
            self.counted[rule_id] += number or 1
            self._explained[rule_id] += (number or 1) - (here[rule_id] or 1 if rule_id in here else 0)
        for rule_id, numbers in group.following.items():
            for root, number in numbers.items():
                totals = self._follows(rule_id, (root, tables.get(root, "")), number or 1)
                totals.groups_of[rule_id] += 1
                totals.attempts_of[rule_id] += number
        return {(rule_id, tables.get(rule_id, "")): number for rule_id, number in here.items()}

    def add_rule_of_dataset(self, rule_id: str) -> None:
        """Add a rule that fails in no single group."""
        roots = self._relation.roots_of(rule_id)
        if not roots:
            self.causes.setdefault((rule_id, ""), _Totals())
        for root in roots:
            for key in [key for key in self.causes if key[0] == root] or [(root, "")]:
                self._follows(rule_id, key, 0).groups_of.setdefault(rule_id, 0)

    def _follows(self, rule_id: str, root: _Key, number: int) -> _Totals:
        """Note that a rule may fail because of a cause, and tell what that adds up."""
        self._following.setdefault(rule_id, Counter())[root[0]] += number
        return self.causes.setdefault(root, _Totals())

    def following(self) -> dict[str, Following]:
        """Rules that may fail because of others."""
        return {
            rule_id: Following(
                tuple((root, roots[root]) for root in sorted(roots, key=cause_order)),
                self._explained[rule_id] if self.counted[rule_id] else None,
                self.counted[rule_id],
            )
            for rule_id, roots in self._following.items()
        }


def _add_extent(totals: _Totals, shard: ShardResult, groups: Sequence[tuple[str, int]]) -> None:
    num_attempts = sum(number for _, number in groups)
    totals.num_shards += 1
    totals.num_groups += len(groups)
    totals.num_attempts += num_attempts
    if len(totals.extents) < MAX_SHARDS:
        first = tuple(name for name, _ in groups[:MAX_NAMED_GROUPS])
        sizes = len(groups), len(shard.funnel.outcomes), num_attempts, len(shard.rollout_ids)
        totals.extents.append(Extent(shard.folder.rpartition("/")[2], first, groups[-1][0], *sizes))


def _cause(key: _Key, tally: Tally, totals: _Totals, num_shards: int, num_groups: int) -> Cause:
    findings = [f for f in tally.findings if not f.follows and (not totals.num_groups or f.group_id in totals.names)]
    findings = [f for f in findings if key[1] in ("", f.location.get("table"))]
    firsts = {_kind_of_place(f): f for f in reversed(findings)}
    return Cause(
        tally.rule_id,
        tuple(sorted({str(f.location["column"]) for f in findings if "column" in f.location})),
        tuple(firsts[place] for place in dict.fromkeys(map(_kind_of_place, findings))),
        tuple(totals.extents),
        totals.num_shards,
        num_shards,
        totals.num_groups,
        totals.num_attempts,
        bool(totals.num_groups) and totals.num_groups == num_groups,
        tuple(_consequences(totals)),
        tuple(sorted(totals.together or (), key=cause_order)),
        "" if findings else totals.detail,
    )


def _kind_of_place(finding: Finding) -> tuple[object, ...]:
    """What findings on rows of one column have in common, and those on one file."""
    parts = ("table", "column") if finding.group_id is not None else ("file", "pointer", "table", "column")
    return tuple(finding.location.get(part) for part in parts)


def _consequences(totals: _Totals) -> Iterator[Consequence]:
    for rule_id in sorted(totals.groups_of, key=cause_order):
        yield Consequence(rule_id, totals.groups_of[rule_id], totals.attempts_of[rule_id])


def _cause_place(cause: Cause) -> tuple[bool, bool, int, tuple[int, int, int]]:
    """Sort key of causes: what decides or costs groups first, the whole dataset before parts of it, then by groups."""
    is_beside = cause.rule_id in _BESIDE
    is_hint = cause.info.level == "SHOULD" or cause.info.kind == "diagnostic"
    return (is_beside or is_hint, cause.num_groups > 0, -cause.num_groups, cause_order(cause.rule_id))
