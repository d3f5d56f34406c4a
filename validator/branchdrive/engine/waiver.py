"""Waivers: failures that are accepted, with a reason and an end.

A waiver names a deciding rule and a glob over the finding's location text. It covers at most
``max_count`` findings as reports count them (a place with three violating rows counts three), and
only as long as it has not expired; whatever it does is printed.
A rule is waived only if every one of its findings is: a rule with more findings than a report
keeps cannot be. Source: spec/07-rules.md#waivers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal

from branchdrive.contract.document import parse_json, schema_mismatches
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.rule import CATALOGUE
from branchdrive.contract.text import nearest
from branchdrive.engine.finding import location_text
from branchdrive.engine.tally import Tally
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.named_file import read_named_file

__all__ = ["Waiver", "WaiverOutcome", "apply_waivers", "load_waivers"]


@dataclass(frozen=True)
class Waiver:
    """One accepted failure."""

    rule: str
    location: str
    reason: str
    expires: date
    max_count: int


@dataclass(frozen=True)
class WaiverOutcome:
    """What became of a waiver: how many findings it matched, and whether it covered them."""

    waiver: Waiver
    num_matched: int
    state: Literal["used", "unused", "expired", "exceeded"]

    def to_json(self) -> dict[str, Any]:
        """The outcome as the report schema has it."""
        w = self.waiver
        return {
            "rule": w.rule,
            "location": w.location,
            "reason": w.reason,
            "expires": w.expires.isoformat(),
            "max_count": w.max_count,
            "num_matched": self.num_matched,
            "state": self.state,
        }


def load_waivers(path: Path) -> tuple[Waiver, ...]:
    """Waivers of a file.

    Raises:
        UsageError: The file is unreadable, breaks its schema, or names a rule that does not decide.
    """
    try:
        document = parse_json(read_named_file(path, spec_limits().max_document_bytes))
    except (DatasetError, ValueError, RecursionError) as error:
        raise UsageError(f"waivers {str(path)!r} cannot be read: {error}") from error
    for wrong in schema_mismatches(document, "waivers.schema.json"):
        pointer = wrong.location["pointer"]
        raise UsageError(f"waivers {str(path)!r}, {pointer}: expected {wrong.expected}, found {wrong.found}")
    waivers = []
    for item in document["waivers"]:
        info = CATALOGUE.get(item["rule"])
        if info is None:
            raise UsageError(f"waivers {str(path)!r}: no rule {item['rule']!r}; {nearest(item['rule'], CATALOGUE)}")
        if not info.decides:
            raise UsageError(
                f"waivers {str(path)!r}: rule {item['rule']!r} is of the kind {info.kind}; it needs no waiver, since "
                "only structure and claim rules make a dataset invalid"
            )
        try:
            expires = date.fromisoformat(item["expires"])
        except ValueError as error:
            raise UsageError(f"waivers {str(path)!r}: {item['expires']!r} is not a date: {error}") from error
        waivers.append(Waiver(item["rule"], item["location"], item["reason"], expires, item["max_count"]))
    return tuple(waivers)


def apply_waivers(tallies: Mapping[str, Tally], waivers: Sequence[Waiver], today: date) -> list[WaiverOutcome]:
    """Mark waived findings in `tallies` and say what each waiver did."""
    outcomes = []
    for waiver in waivers:
        tally = tallies.get(waiver.rule)
        findings = tally.findings if tally else []
        matching = [
            i
            for i, f in enumerate(findings)
            if not f.waived and fnmatchcase(location_text(f.location), waiver.location)
        ]
        num_matched = sum(findings[i].count for i in matching)
        state: Literal["used", "unused", "expired", "exceeded"] = "used"
        if waiver.expires < today:
            state = "expired"
        elif not matching:
            state = "unused"
        elif num_matched > waiver.max_count:
            state = "exceeded"
        else:
            for i in matching:
                findings[i] = replace(findings[i], waived=True)
        outcomes.append(WaiverOutcome(waiver, num_matched, state))
    return outcomes
