"""Running totals of one rule: what was examined, what was found, what could not be judged."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from types import MappingProxyType
from typing import Literal

import numpy as np

from branchdrive.contract.mismatch import MAX_KEPT
from branchdrive.contract.rule import CATALOGUE, RuleInfo
from branchdrive.engine.finding import Finding

__all__ = ["MAX_FINDINGS_PER_RULE", "RuleStatus", "Tallies", "Tally"]

MAX_FINDINGS_PER_RULE = MAX_KEPT
"""Findings kept per rule; counts stay exact."""

_NO_STREAM = "the descriptor claims no stream that this rule is about"
_NO_GROUPS = "drives are in no branch group"

RuleStatus = Literal["pass", "fail", "skipped", "not-claimed", "inconclusive", "error"]


@dataclass
class Tally:
    """Totals of one rule on a shard or on the whole dataset; totals of shards add up.

    Attributes:
        rule_id: The rule.
        examined: Subjects looked at.
        total: Subjects there are, examined or not.
        num_findings: Violating subjects, exact.
        findings: The first of them, at most `MAX_FINDINGS_PER_RULE`.
        is_claimed: Whether the descriptor claims what the rule is about.
        unjudged: Why the rule could not be judged although there may be subjects; ``None`` if it could.
        is_exceeded: Whether that is because judging it takes more than this machine was allowed.
        errors: Failures of the tool itself.
    """

    rule_id: str
    examined: int = 0
    total: int = 0
    num_findings: int = 0
    findings: list[Finding] = field(default_factory=list)
    is_claimed: bool = True
    unjudged: str | None = None
    is_exceeded: bool = False
    errors: list[str] = field(default_factory=list)

    @property
    def info(self) -> RuleInfo:
        """The rule's catalogue entry."""
        return CATALOGUE[self.rule_id]

    def add(self, other: Tally) -> None:
        """Merge the totals of another part of the dataset."""
        self.examined += other.examined
        self.total += other.total
        self.num_findings += other.num_findings
        self.keep(other.findings)
        self.is_claimed &= other.is_claimed
        self.unjudged = self.unjudged or other.unjudged
        self.is_exceeded |= other.is_exceeded
        self.errors += other.errors

    def keep(self, findings: Iterable[Finding]) -> None:
        """Keep findings as far as the cap allows."""
        room = MAX_FINDINGS_PER_RULE - len(self.findings)
        self.findings += islice(findings, max(room, 0))

    def places(self, findings: Iterable[Finding]) -> int:
        """What `findings` count for in `num_findings`: their rows for rules on rows, else one each."""
        return sum(f.count if self.info.grain == "row" else 1 for f in findings)

    @property
    def status(self) -> RuleStatus:
        """Status of the rule; nothing examined is never a pass."""
        if self.errors:
            return "error"
        if self.num_findings:
            return "fail"
        if not self.is_claimed:
            return "not-claimed"
        if self.is_exceeded:
            return "inconclusive"
        if self.unjudged or not self.examined:
            return "skipped"
        return "pass"

    @property
    def reason(self) -> str | None:
        """Why the rule did not run, or not everywhere."""
        if self.errors:
            return self.errors[0].splitlines()[-1][:300]
        if not self.is_claimed:
            if self.info.layer:
                return f"the descriptor does not claim the {self.info.layer} layer"
            return _NO_GROUPS if self.info.scope == "group" else _NO_STREAM
        if self.unjudged:
            return self.unjudged
        return None if self.examined else "no subject"


_RULES = tuple(CATALOGUE)
_PLACES = {rule_id: place for place, rule_id in enumerate(_RULES)}


class Tallies(Mapping[str, Tally]):
    """Totals of rules on one shard, by rule: numbers, as nearly all are nothing else, and the others as they are.

    Args:
        tallies: The totals, which do not change any more.
    """

    def __init__(self, tallies: Mapping[str, Tally] = MappingProxyType({})) -> None:
        every = [*tallies.values()]
        self._rules = np.array([_PLACES[rule_id] for rule_id in tallies], np.int16)
        numbers = [(tally.examined, tally.total, tally.num_findings, tally.is_claimed) for tally in every]
        self._numbers = np.array(numbers, np.int64).reshape(len(numbers), 4)
        self._others = {t.rule_id: t for t in every if t.findings or t.unjudged or t.is_exceeded or t.errors}

    def __repr__(self) -> str:
        return f"Tallies({ {**self} })"

    def __len__(self) -> int:
        return len(self._rules)

    def __iter__(self) -> Iterator[str]:
        return (_RULES[place] for place in self._rules.tolist())

    def __getitem__(self, rule_id: str) -> Tally:
        if rule_id in self._others:
            return self._others[rule_id]
        (rows,) = np.nonzero(self._rules == _PLACES[rule_id])
        if not len(rows):
            raise KeyError(rule_id)
        examined, total, num_findings, is_claimed = self._numbers[rows[0]].tolist()
        return Tally(rule_id, examined, total, num_findings, is_claimed=bool(is_claimed))
