"""Which rules may fail because of others, so that no column that is right is changed.

What is recomputed from a wrong column differs from what is recorded, and what is expected there is the wrong one.
"""

from __future__ import annotations

from collections.abc import Iterable

from branchdrive.contract.rule import cause_order
from branchdrive.engine.report import Report
from branchdrive.engine.tally import Tally

__all__ = ["causes", "causes_text"]

_MOTION = (
    "BD-GRP-009", "BD-GRP-010", "BD-MOT-006", "BD-MOT-001", "BD-BOX-001", "BD-BOX-002", "BD-BOX-003", "BD-RSP-001",
    "BD-RSP-006", "BD-RSP-007",
)  # fmt: skip
"""Rules of which a failure tells of the future of another action, of a wrong unit, sign, clock or size."""

_FOLLOWING = ("BD-MOT-003", "BD-RPN-003", "BD-ACT-004", "BD-RSP-016")
"""Rules that recompute from such columns, beside those of evidence."""


def causes(tally: Tally, report: Report) -> list[str]:
    """Rules that fail for a group of this one, or for the whole dataset, and may be why this one fails."""
    if tally.rule_id == "BD-TAB-004":
        possible: tuple[str, ...] = ("BD-LAY-001",)
    elif tally.rule_id.startswith("BD-EVD-") or tally.rule_id in _FOLLOWING:
        possible = _MOTION
    else:
        return []
    failed = (other for other in report.tallies if other.rule_id in possible and other.num_findings)
    return sorted((other.rule_id for other in failed if _may_cause(other, tally)), key=cause_order)


def _may_cause(cause: Tally, tally: Tally) -> bool:
    if cause.rule_id == "BD-LAY-001":
        return True
    if "dataset" in (cause.info.grain, tally.info.grain):
        # What says that nearly all attempts fail a rule is no cause of it.
        return any(not finding.expected.startswith(tally.rule_id) for finding in cause.findings)
    return not _groups(cause).isdisjoint(_groups(tally))


def _groups(tally: Tally) -> set[str]:
    return {finding.group_id for finding in tally.findings if finding.group_id is not None}


def causes_text(rules: Iterable[str]) -> str:
    """The rules in words."""
    return f"may follow from {', '.join(rules)}: look there first"
