"""Findings: where something is wrong, what was expected, what was found and what to do.

Source: spec/07-rules.md#findings.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from branchdrive.contract.mismatch import Location, Mismatch
from branchdrive.contract.rule import CATALOGUE, Kind
from branchdrive.contract.text import printable
from branchdrive.engine.relation import repair_first

__all__ = ["Finding", "location_text"]


def location_text(location: Location) -> str:
    """A place as one line, for people and for waiver globs: ``file=raw/.. rollout_id=.. tick=..``."""
    return " ".join(f"{key}={value}" for key, value in location.items()) or "dataset"


@dataclass(frozen=True)
class Finding:
    """One violation of a rule, as reports carry it.

    Attributes:
        rule: The rule.
        location: Where it is.
        count: Items that it stands for.
        expected: What was expected there.
        found: What was found.
        waived: Whether a waiver covers it.
        group_id: The branch group that it is about, safe to print; ``None`` where it is about no single one.
        last_tick: The last tick of its items, of which the location has the first; ``None`` where it is not known.
        branch_tick: That of its attempt; ``None`` where there is none.
        follows: Rules that fail there too and may be why, first causes first; none where nothing explains it.
    """

    rule: str
    location: Location
    count: int
    expected: str
    found: str
    waived: bool = False
    group_id: str | None = None
    last_tick: int | None = None
    branch_tick: int | None = None
    follows: tuple[str, ...] = ()

    @classmethod
    def of(cls, rule_id: str, mismatch: Mismatch) -> Finding:
        """Finding of a rule from a mismatch; free text is made safe to print."""
        location = {
            key: value if isinstance(value, int) else printable(value[:500])[:500]
            for key, value in mismatch.location.items()
        }
        group_id = mismatch.location.get("group_id", mismatch.group_id)
        expected, found = (printable(text[:300])[:300] for text in (mismatch.expected, mismatch.found))
        return cls(
            rule_id,
            location,
            mismatch.count,
            expected,
            found,
            group_id=None if group_id is None else printable(str(group_id)[:128]),
            last_tick=mismatch.last_tick,
            branch_tick=mismatch.branch_tick,
        )

    @property
    def kind(self) -> Kind:
        """Kind of the violated rule."""
        return CATALOGUE[self.rule].kind

    @property
    def is_recommendation(self) -> bool:
        """Whether the violated rule recommends, and costs neither a group nor the dataset."""
        return CATALOGUE[self.rule].level == "SHOULD"

    @property
    def message(self) -> str:
        """The finding as one sentence."""
        more = f" ({self.count} places)" if self.count > 1 else ""
        title = CATALOGUE[self.rule].broken
        return f"{title}: {location_text(self.location)}{more}: expected {self.expected}, found {self.found}"

    @property
    def remedy(self) -> str:
        """What to do: the rule's remedy, or where others may be why, to repair these first."""
        return repair_first(self.rule, self.follows) if self.follows else CATALOGUE[self.rule].remedy

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
            "remedy": self.remedy,
            "waived": self.waived,
            "last_tick": self.last_tick,
            "branch_tick": self.branch_tick,
            "follows": list(self.follows),
        }
