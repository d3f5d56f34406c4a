"""A table as a value: what it says, whatever prints it.

Cells are plain text. What prints a table escapes what its medium would not show as it is, so that cells may hold text
of others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

__all__ = ["Column", "Passage", "Table"]


class Column(NamedTuple):
    """One column.

    Attributes:
        title: Its heading, with the unit after a comma.
        is_text: Whether cells are text, which stand on the left and may be folded; numbers stand on the right.
        is_name: Whether the column tells what a row is about: terminals repeat it beside every part of a wide table,
            and leave a cell blank that says the same as the one above, but for that of the last such column.
        is_code: Whether cells are identifiers.
    """

    title: str
    is_text: bool = False
    is_name: bool = False
    is_code: bool = False

    @classmethod
    def name(cls, title: str, *, is_code: bool = False) -> Column:
        """A column of texts that tells what a row is about."""
        return cls(title, is_text=True, is_name=True, is_code=is_code)


@dataclass(frozen=True)
class Table:
    """A titled table.

    Attributes:
        title: One line.
        columns: At least one.
        rows: A cell for every column.
        notes: Paragraphs below the table.
        has_total: Whether the last row is what the others lead to.
        has_intervals: Whether it tells what is certain: intervals or tests.
    """

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()
    has_total: bool = False
    has_intervals: bool = False

    def __post_init__(self) -> None:
        wrong = [row for row in self.rows if len(row) != len(self.columns)]
        if wrong:
            raise ValueError(f"table {self.title!r} has {len(self.columns)} columns, but a row {list(wrong[0])!r}")

    def only(self, places: Sequence[int]) -> Table:
        """The table with the columns at these places."""
        return replace(
            self, columns=[self.columns[i] for i in places], rows=[[row[i] for i in places] for row in self.rows]
        )


class Passage(NamedTuple):
    """Titled paragraphs between tables."""

    title: str
    paragraphs: Sequence[str]
