"""A section of the pilot report as a value: what was examined, what is wrong and what to do, what was not examined."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from branchdrive.text.table import Table

__all__ = ["Concern", "Result", "Section"]

Result = Literal["problem", "not examined", "advice", "in part", "fine"]


@dataclass(frozen=True)
class Concern:
    """Something to be changed.

    Attributes:
        what: What was found, one or more sentences.
        remedy: What to do about it, exactly.
        is_problem: Whether it must be settled before more is collected; else it is advice.
    """

    what: str
    remedy: str
    is_problem: bool = True

    def to_json(self) -> dict[str, str]:
        """As the schema of the pilot report has it."""
        return {"kind": "problem" if self.is_problem else "advice", "what": self.what, "remedy": self.remedy}


@dataclass(frozen=True)
class Section:
    """One topic of the report.

    Attributes:
        name: Key in JSON.
        title: One line.
        facts: What was found, sentences.
        concerns: What is to be changed.
        tables: Figures for people.
        not_examined: What could not be looked at, each with its reason.
        figures: The numbers for programs, by name.
        explains: Rules that fail for what its concerns name.
    """

    name: str
    title: str
    facts: Sequence[str] = ()
    concerns: Sequence[Concern] = ()
    tables: Sequence[Table] = ()
    not_examined: Sequence[str] = ()
    figures: Mapping[str, Any] = field(default_factory=dict)
    explains: Collection[str] = ()

    @property
    def result(self) -> Result:
        """What the section comes to; what nothing was examined of is never fine."""
        if any(concern.is_problem for concern in self.concerns):
            return "problem"
        if not (self.facts or self.tables or self.concerns):
            return "not examined"
        if self.concerns:
            return "advice"
        return "in part" if self.not_examined else "fine"

    def to_json(self) -> dict[str, Any]:
        """As the schema of the pilot report has it."""
        return {
            "name": self.name,
            "title": self.title,
            "result": self.result,
            "facts": list(self.facts),
            "concerns": [concern.to_json() for concern in self.concerns],
            "not_examined": list(self.not_examined),
            "figures": dict(self.figures),
            "tables": [
                {
                    "title": table.title,
                    "columns": [column.title for column in table.columns],
                    "rows": [list(row) for row in table.rows],
                    "notes": list(table.notes),
                }
                for table in self.tables
            ],
        }
