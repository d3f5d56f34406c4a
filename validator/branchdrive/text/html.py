"""Names with texts, and tables, as HTML for notebooks: every text is escaped."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from branchdrive.text.table import Table

__all__ = ["html_of"]

_MOST_ROWS = 50
"""Rows of a table that a notebook shows."""


def html_of(title: str, facts: Iterable[tuple[str, str]], tables: Iterable[Table] = ()) -> str:
    """A titled list of facts with tables below it, as one element.

    Args:
        title: What it is about.
        facts: Names with what is to be said of each; those without a text are left out.
        tables: At most 50 rows of each are shown.
    """
    shown = "".join(f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in facts if text)
    return f"<div><strong>{escape(title)}</strong><table>{shown}</table>{''.join(map(_table, tables))}</div>"


def _table(table: Table) -> str:
    head = "".join(f"<th>{escape(column.title)}</th>" for column in table.columns)
    rows = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in table.rows[:_MOST_ROWS])
    more = len(table.rows) - _MOST_ROWS
    note = f"<p>and {more:,} more rows</p>" if more > 0 else ""
    return f"<table><caption>{escape(table.title)}</caption><tr>{head}</tr>{rows}</table>{note}"
