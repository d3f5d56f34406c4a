"""Findings: where something is wrong, what was expected, what was found and what to do.

Source: spec/07-rules.md#findings.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from branchdrive.contract.catalogue import CATALOGUE, Kind

__all__ = ["Finding", "Sighting", "location_text", "printable", "quote"]

MAX_QUOTED = 160
"""Characters of a quoted value in a finding."""


def printable(text: str) -> str:
    """`text` on one line of printable ASCII, every other character escaped: safe on any terminal."""
    return "".join(c if " " <= c <= "~" else ascii(c)[1:-1] for c in text)


def quote(value: object) -> str:
    """`value` by repr, shortened, in printable ASCII: a report must be safe to print whatever a dataset holds."""
    text = ascii(value.item() if hasattr(value, "item") and getattr(value, "ndim", 1) == 0 else value)
    return text if len(text) <= MAX_QUOTED else text[: MAX_QUOTED - 3] + "..."


@dataclass(frozen=True)
class Sighting:
    """What a rule saw at one violating subject, before the engine adds identity and wording.

    Attributes:
        expected: What the clause demands there.
        found: What the dataset has there.
        location: Parts of the place: file, pointer, table, column, group_id, rollout_id, tick, actor_id.
        count: Violating items that this sighting stands for.
    """

    expected: str
    found: str
    location: dict[str, str | int] = field(default_factory=dict)
    count: int = 1


def location_text(location: dict[str, str | int]) -> str:
    """A place as one line, for people and for waiver globs: ``file=raw/.. rollout_id=.. tick=..``."""
    return " ".join(f"{key}={value}" for key, value in location.items()) or "dataset"


@dataclass(frozen=True)
class Finding:
    """One violation of a rule, as reports carry it."""

    rule: str
    location: dict[str, str | int]
    count: int
    expected: str
    found: str
    waived: bool = False

    @classmethod
    def of(cls, rule_id: str, sighting: Sighting) -> Finding:
        """Finding of a rule from what it saw; free text is made safe to print."""
        location = {
            key: value if isinstance(value, int) else printable(value[:500])[:500]
            for key, value in sighting.location.items()
        }
        expected, found = (printable(text[:300])[:300] for text in (sighting.expected, sighting.found))
        return cls(rule_id, location, sighting.count, expected, found)

    @property
    def kind(self) -> Kind:
        """Kind of the violated rule."""
        return CATALOGUE[self.rule].kind

    @property
    def message(self) -> str:
        """The finding as one sentence."""
        more = f" ({self.count} places)" if self.count > 1 else ""
        title = CATALOGUE[self.rule].title
        return f"{title}: {location_text(self.location)}{more}: expected {self.expected}, found {self.found}"

    def to_json(self) -> dict[str, Any]:
        """The finding as the report schema has it."""
        return {
            "rule": self.rule,
            "kind": self.kind,
            "location": self.location,
            "count": self.count,
            "expected": self.expected,
            "found": self.found,
            "message": self.message,
            "remedy": CATALOGUE[self.rule].remedy,
            "waived": self.waived,
        }
