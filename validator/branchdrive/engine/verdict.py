"""Verdicts: what the rules together mean for the dataset.

The table of spec/07-rules.md#verdicts; the first row that applies decides.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

from branchdrive.engine.tally import Tally

__all__ = ["Verdict", "decide", "is_waived"]

Verdict = Literal["valid", "valid-with-waivers", "partial", "invalid", "error"]


def is_waived(tally: Tally) -> bool:
    """Whether every finding of a failed rule is waived."""
    complete = tally.places(tally.findings) >= tally.num_findings
    return bool(tally.findings) and complete and all(f.waived for f in tally.findings)


def decide(tallies: Iterable[Tally], errors: Iterable[str] = ()) -> Verdict:
    """Verdict over the tallies of all rules.

    Args:
        tallies: One per rule of the catalogue.
        errors: Failures of the tool outside any rule.
    """
    tallies = list(tallies)
    if list(errors) or any(tally.status == "error" for tally in tallies):
        return "error"
    deciding = [tally for tally in tallies if tally.info.decides]
    failed = [tally for tally in deciding if tally.status == "fail"]
    if not all(map(is_waived, failed)):
        return "invalid"
    if any(tally.unjudged for tally in deciding if tally.is_claimed):
        return "partial"
    return "valid-with-waivers" if failed else "valid"
