"""Running totals of one rule: what was examined, what was found, what could not be judged."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import islice
from typing import Literal

import numpy as np
from numpy.typing import NDArray

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


@lru_cache(maxsize=64)
def _rows_of(places: bytes) -> Mapping[str, int]:
    """Rules by their places in the catalogue, each with its number among them: one for all shards with these rules."""
    return {_RULES[place]: row for row, place in enumerate(np.frombuffer(places, np.int16).tolist())}


class Tallies(Mapping[str, Tally]):
    """Totals of rules on one shard, by rule: numbers, as nearly all are nothing else, and the others as they are.

    Args:
        rules: Rules, each once.
        numbers: What a rule examined, its subjects, its findings, and 1 where it is claimed ``[rules, 4]``.
        others: Totals that are more than these numbers.

    Raises:
        KeyError: There is no such rule.
        TypeError: What is no number, or no totals.
        ValueError: The numbers are not those of the rules.
    """

    def __init__(self, rules: Sequence[str], numbers: NDArray[np.int64], others: Sequence[Tally] = ()) -> None:
        if numbers.shape != (len(rules), 4) or numbers.dtype != np.int64 or len({*rules}) < len(rules):
            raise ValueError(f"numbers {numbers.dtype} {numbers.shape} of {len(rules)} rules")
        self._places = np.array([_PLACES[rule_id] for rule_id in rules], np.int16).tobytes()
        self._numbers = numbers
        self._others = {tally.rule_id: tally for tally in others}
        if not self._others.keys() <= _rows_of(self._places).keys():
            raise ValueError(f"no numbers of {', '.join(self._others)}")

    @classmethod
    def of(cls, tallies: Mapping[str, Tally]) -> Tallies:
        """Totals by rule, which do not change any more."""
        every = [*tallies.values()]
        numbers = [(tally.examined, tally.total, tally.num_findings, tally.is_claimed) for tally in every]
        others = [t for t in every if t.findings or t.unjudged or t.is_exceeded or t.errors]
        return cls([*tallies], np.array(numbers, np.int64).reshape(len(numbers), 4), others)

    @property
    def others(self) -> list[Tally]:
        """Totals that are more than numbers."""
        return [*self._others.values()]

    @property
    def parts(self) -> tuple[list[str], NDArray[np.int64], list[Tally]]:
        """What it is made of."""
        return [*self], self._numbers, self.others

    def __repr__(self) -> str:
        return f"Tallies({ {**self} })"

    def __len__(self) -> int:
        return len(self._numbers)

    def __iter__(self) -> Iterator[str]:
        return iter(_rows_of(self._places))

    def __getitem__(self, rule_id: str) -> Tally:
        if rule_id in self._others:
            return self._others[rule_id]
        return _of_numbers(rule_id, self._numbers[_rows_of(self._places)[rule_id]].tolist())

    @staticmethod
    def total(parts: Iterable[Tallies]) -> dict[str, Tally]:
        """Totals by rule of all parts together."""
        sums: dict[bytes, list[NDArray[np.int64]]] = {}
        others: list[Tally] = []
        for part in parts:
            sums.setdefault(part._places, []).append(part._numbers)
            others += part.others
        found: dict[str, Tally] = {}
        for places, numbers in sums.items():
            counts = np.sum(numbers, axis=0)
            counts[:, 3] = counts[:, 3] == len(numbers)
            for rule_id, row in zip(_rows_of(places), counts.tolist(), strict=True):
                found.setdefault(rule_id, Tally(rule_id)).add(_of_numbers(rule_id, row))
        for other in others:  # whose numbers are among those
            found[other.rule_id].add(replace(other, examined=0, total=0, num_findings=0))
        return found


def _of_numbers(rule_id: str, numbers: Sequence[int]) -> Tally:
    examined, total, num_findings, is_claimed = numbers
    return Tally(rule_id, examined, total, num_findings, is_claimed=bool(is_claimed))
