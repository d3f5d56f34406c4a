"""Tables as Markdown (GitHub's tables), byte by byte the same for the same value."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from branchdrive.contract.text import printable
from branchdrive.text.table import Column, Passage, Table

__all__ = ["code_span", "grid", "plain", "section_lines"]

_TAG = re.compile(r"<(?![ =])")


def section_lines(section: Table | Passage, warnings: Iterable[str] = ()) -> list[str]:
    """Lines of a table, with `warnings` below its title so that it is not quoted without them, or of a passage."""
    heading = f"## {section.title}"
    if isinstance(section, Passage):
        return [heading, *(line for text in section.paragraphs for line in ("", plain(text)))]
    cells = (
        [
            f"`{plain(cell)}`" if column.is_code else plain(cell)
            for column, cell in zip(section.columns, row, strict=True)
        ]
        for row in section.rows
    )
    lines = [heading, ""]
    for warning in warnings:
        lines += [f"> **Warning.** {plain(warning)}", ""]
    lines += grid(section.columns, cells)
    return [*lines, *(line for note in section.notes for line in ("", plain(note)))]


def grid(columns: Sequence[Column], rows: Iterable[Sequence[str]]) -> list[str]:
    """Head and rows alone, of cells that are Markdown."""
    rule = ["---" if column.is_text else "--:" for column in columns]
    return [f"| {' | '.join(cells)} |" for cells in ([column.title for column in columns], rule, *rows)]


def plain(text: str) -> str:
    """Text on one line without a cell or a tag of its own; a sign of comparison before a blank stays."""
    return _TAG.sub("&lt;", text.replace("|", "\\|"))


def code_span(text: str) -> str:
    """Text of anyone, in which no renderer finds markup: on one line, between more back-ticks than it has in a row.

    It is for places outside of tables, whose cells a bar would end even here.
    """
    shown = printable(text) or " "
    fence = "`" * (1 + max(map(len, re.findall("`+", shown)), default=0))
    pad = " " if shown[0] in "` " or shown[-1] in "` " else ""
    return f"{fence}{pad}{shown}{pad}{fence}"
