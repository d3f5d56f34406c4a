"""What became of one branch group, for people who ask which of theirs fail and why. Source: spec/07-rules.md#report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeAlias

from branchdrive.contract.rule import CATALOGUE, cause_order
from branchdrive.contract.text import printable
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive.engine.finding import Finding
from branchdrive.raw.funnel import LACKS, STAGES, GroupOutcome

__all__ = ["FirstFindings", "GroupResult", "detail_of", "hint_of"]

FirstFindings: TypeAlias = Mapping[tuple[str | None, str], Finding]
_NO_FINDINGS: FirstFindings = MappingProxyType({})
_MAX_FOUND = 120
"""Characters of what was expected, and of what was found, that a reason repeats."""

_COPIES = ("BD-RSP-005", "BD-RSP-015")
"""Rules that find a group to be another one under a name of its own, whatever it lacks then."""

_JUMP, _SEPARATION = "BD-MOT-001", "BD-EVD-001"
"""A single jump of the ego, from which on it does not fit its actors: it was put among them."""

_NO_BRANCH = "no attempt has a branch: where nothing happened on this drive that calls for one, nothing is to be done"


@dataclass(frozen=True)
class GroupResult:
    """How far one group gets in the funnel.

    Attributes:
        group_id: The group, safe to print.
        stage: Title of the stage that it is lost at; ``None`` where it qualifies.
        rules: Rules that it fails there, causes before their consequences.
        reason: What it lacks in words, what was expected and found, after what may be the cause where its findings
            tell; empty where it qualifies.
        further: Rules that it or attempts of it fail beside these, wherever they would cost it, in the same order.
        detail: The part of the reason that tells what was expected and found.
    """

    group_id: str
    stage: str | None
    rules: tuple[str, ...]
    reason: str
    further: tuple[str, ...] = ()
    detail: str = ""

    @classmethod
    def of(cls, outcome: GroupOutcome, findings: FirstFindings = _NO_FINDINGS) -> GroupResult:
        """Result of a group from its outcome in the funnel, and from the first kept finding of each group and rule.

        What the outcome tells itself comes first: findings that a report keeps are those of the first groups alone.
        """
        group_id = printable(outcome.group_id[:128])
        if outcome.lost_at is None:
            return cls(group_id, None, (), "")
        rules = tuple(sorted(outcome.rules, key=cause_order))
        if not outcome.is_branched:
            return cls(group_id, STAGES[outcome.lost_at], rules, _NO_BRANCH)
        detail = outcome.detail or detail_of(outcome, findings)
        copy = next((findings[group_id, rule] for rule in _COPIES if (group_id, rule) in findings), None)
        parts = [
            "" if copy is None else f"repeats another group, {_shortened(copy.found)}",
            outcome.hint or hint_of(group_id, findings),
            f"does not hold: {CATALOGUE[rules[0]].title}{detail}",
        ]
        costly = (rule for rule, _ in outcome.failed if CATALOGUE[rule].kind in ("structure", "qualification"))
        further = tuple(sorted({*costly} - {*rules}, key=cause_order))
        return cls(group_id, STAGES[outcome.lost_at], rules, "; ".join(filter(None, parts)), further, detail)

    @property
    def lacks(self) -> str:
        """What it is that it is lost for, in few words; empty where it qualifies."""
        return next((LACKS[name] for name, title in STAGES.items() if title == self.stage and name in LACKS), "")

    @property
    def qualifies(self) -> bool:
        """Whether it passes every stage."""
        return self.stage is None

    def to_json(self) -> dict[str, Any]:
        """The result as the report schema has it."""
        return {
            "id": self.group_id,
            "qualifies": self.qualifies,
            "stage": self.stage,
            "rules": list(self.rules),
            "reason": self.reason,
            "further": list(self.further),
        }


def detail_of(outcome: GroupOutcome, findings: FirstFindings) -> str:
    """Column, and what was expected and found, of the first rule that costs a group; empty where it is not kept."""
    group_id, rule_id = printable(outcome.group_id[:128]), min(outcome.rules, key=cause_order)
    if (first := findings.get((group_id, rule_id))) is None:
        return ""
    column = f", in {first.location['column']}" if "column" in first.location else ""
    return f"{column}: expected {_shortened(first.expected)}, found {_shortened(first.found)}"


def hint_of(group_id: str, findings: FirstFindings) -> str:
    """What findings of several rules together say of a group, in words; empty where they say nothing."""
    jump, evidence = (findings.get((group_id, rule)) for rule in (_JUMP, _SEPARATION))
    if jump is None or evidence is None or jump.count > 1:
        return ""
    tick = jump.location.get("tick")
    if tick is None or tick != evidence.location.get("tick"):
        return ""
    if tick == OBSERVATION_STRIDE_TICKS:
        return "its observations may be late against its actors, which they do not fit from the first step on"
    return f"the ego from tick {tick} on may be of another drive: it jumps there, and its actors do not"


def _shortened(text: str) -> str:
    """A text of findings that is not long, and safe in a code span of a cell."""
    text = text.replace("`", "'")
    return text if len(text) <= _MAX_FOUND else f"{text[: _MAX_FOUND - 3]}..."
