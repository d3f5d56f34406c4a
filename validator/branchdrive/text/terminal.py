"""Tables and texts on a terminal, or as plain text of a fixed width where there is none.

A table that is too wide is parted: its columns stand in several blocks below each other, each with the columns that
name the rows. Numbers stay whole, and no column is lost but those that have nothing in any row. Characters that are not
ASCII are escaped, because text of others may hold any, but for the signs ± and †.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from io import StringIO
from typing import TextIO

from rich.box import Box
from rich.console import Console
from rich.table import Table as Grid
from rich.text import Text

from branchdrive.contract.text import printable
from branchdrive.text.table import Column, Passage, Table

__all__ = ["PLAIN_WIDTH", "print_facts", "print_section", "render"]

PLAIN_WIDTH = 120
"""Columns of text that goes to no terminal."""

_GAP = 2
_LEAST_TEXT = 24
"""Texts are not folded to less than this before the table is parted."""

_SPARED = "±†"
"""The sign of a spread, and the mark of what reads more than sensors."""

_RULED = Box("    \n    \n -- \n    \n -- \n -- \n    \n    \n", ascii=True)
"""Rules of dashes below the head and above the total, and nothing else."""

_VERDICTS = {
    "green": re.compile(r"\b(?<!not )(?:pass|met)\b"),
    "red": re.compile(r"\b(?:fail|missed|not met)\b"),
    "yellow": re.compile(r"\bnot judged\b"),
}


def render(draw: Callable[[Console], None], stdout: TextIO, *, is_file: bool = False) -> str:
    """What `draw` prints, without the blanks that fill lines up.

    Args:
        draw: Prints on a console.
        stdout: Where the text is to go: a terminal gets its own width, and colour unless the user wants otherwise.
        is_file: Whether it goes to a file instead, which has no colour ever.
    """
    buffer = StringIO()
    is_terminal = stdout.isatty() and not is_file
    width = Console(file=stdout).width if is_terminal else PLAIN_WIDTH
    is_coloured = not is_file and _wants_colour(stdout)
    draw(Console(file=buffer, force_terminal=is_coloured, no_color=False, width=width, highlight=False, emoji=False))
    return "\n".join(line.rstrip(" ") for line in buffer.getvalue().split("\n"))


def _wants_colour(stdout: TextIO) -> bool:
    """Whether to colour: `NO_COLOR` forbids it, `FORCE_COLOR` asks for it, else a terminal decides.

    Source: no-color.org, force-color.org; as Python itself does, the first wins over the second.
    """
    if os.environ.get("NO_COLOR"):
        return False
    return bool(os.environ.get("FORCE_COLOR")) or stdout.isatty()


def _escaped(text: str) -> str:
    """Text of anyone, safe on any terminal."""
    return "".join(part if part in _SPARED else printable(part) for part in re.split(f"([{_SPARED}])", text))


def print_section(console: Console, section: Table | Passage, warnings: Iterable[str] = ()) -> None:
    """Print a table, with `warnings` below its title, or a passage."""
    console.print(Text(_escaped(section.title), style="bold"))
    if isinstance(section, Passage):
        console.print(Text("\n\n".join(map(_escaped, section.paragraphs))))
        return
    for warning in warnings:
        console.print(Text(f"Warning: {_escaped(warning)}", style="yellow"))
    columns = [column._replace(title=_escaped(column.title)) for column in section.columns]
    _print_rows(console, replace(section, columns=columns, rows=[[*map(_escaped, row)] for row in section.rows]))
    for note in section.notes:
        console.print(Text(_escaped(note), style="dim"))


def print_facts(console: Console, facts: Iterable[tuple[str, str]]) -> None:
    """Names with what is to be said of each, one below the other."""
    grid = Grid(box=None, show_header=False, pad_edge=False, padding=(0, _GAP, 0, 0))
    grid.add_column(style="dim")
    grid.add_column(overflow="fold")
    for name, text in facts:
        grid.add_row(Text(_escaped(name)), Text(_escaped(text)))
    console.print(grid)


def _print_rows(console: Console, table: Table) -> None:
    blocks = _blocks(table, console.width)
    if table.rows and (blocks is None or len(blocks) > 1):
        table = table.only([i for i, column in enumerate(table.columns) if column.is_name or _has_cells(table, i)])
        blocks = _blocks(table, console.width)
    if blocks is None:
        for row in table.rows:
            titles = [column.title for column in table.columns]
            print_facts(console, [fact for fact in zip(titles, row, strict=True) if fact[1]])
            console.print()
        return
    for i, places in enumerate(blocks):
        if i:
            console.print()
        _print_block(console, table.only(places))


def _has_cells(table: Table, place: int) -> bool:
    return any(row[place] for row in table.rows)


def _print_block(console: Console, table: Table) -> None:
    """One block, whose columns fit side by side."""
    widths = _widths(table, console.width)
    grid = Grid(box=_RULED, show_edge=False, pad_edge=False, collapse_padding=True, header_style="bold")
    for column, width in zip(table.columns, widths, strict=True):
        side = "left" if column.is_text else "right"
        grid.add_column(Text(_folded(column.title, width)), justify=side, width=width, overflow="fold")  # type: ignore[arg-type]
    above: Sequence[str] | None = None
    for i, row in enumerate(table.rows):
        is_total = table.has_total and i == len(table.rows) - 1
        if is_total:
            grid.add_section()
        grid.add_row(*_cells(table.columns, row, above), style="bold" if is_total else "")
        above = row
    console.print(grid)


def _cells(columns: Sequence[Column], row: Sequence[str], above: Sequence[str] | None) -> list[Text]:
    """Cells of a row; leading names that repeat those of the row above are blank, but for the last one."""
    last_name = max((i for i, column in enumerate(columns) if column.is_name), default=0)
    repeats = above is not None
    cells = []
    for i, (column, cell) in enumerate(zip(columns, row, strict=True)):
        if column.is_name:
            repeats = repeats and above is not None and above[i] == cell and i != last_name
            cells.append(Text("" if repeats else cell))
            continue
        text = Text(cell)
        for style, words in _VERDICTS.items():
            text.highlight_regex(words, style)
        cells.append(text)
    return cells


def _blocks(table: Table, width: int) -> list[list[int]] | None:
    """Places of the columns of every block; ``None`` where a block of one column beside the names is too wide."""
    least = [_least_width(table, i) + _GAP for i in range(len(table.columns))]
    names = [i for i, column in enumerate(table.columns) if column.is_name]
    room = width + _GAP - sum(least[i] for i in names)
    others = [i for i in range(len(table.columns)) if i not in names]
    if room < max((least[i] for i in others), default=0):
        return None
    blocks, used = [names.copy()], 0
    for i in others:
        if used + least[i] > room:
            blocks.append(names.copy())
            used = 0
        blocks[-1].append(i)
        used += least[i]
    return blocks


def _widths(table: Table, width: int) -> list[int]:
    """Widths of columns that fit: as wide as they are, else the widest narrowed first."""
    columns = range(len(table.columns))
    least = [_least_width(table, i) for i in columns]
    widths = [max(len(table.columns[i].title), *(len(row[i]) for row in table.rows), 0) for i in columns]
    while sum(widths) > width - _GAP * (len(widths) - 1):
        widest = max((i for i in columns if widths[i] > least[i]), key=widths.__getitem__)
        widths[widest] -= 1
    return widths


def _least_width(table: Table, place: int) -> int:
    """What a column takes at least: a word of its title, and a whole number or some words of a text."""
    column = table.columns[place]
    cells = [row[place] for row in table.rows]
    title = max(map(len, _pieces(column.title)))
    longest = max(map(len, cells), default=0)
    if column.is_name or not column.is_text:
        return max(title, longest)
    words = max((len(word) for cell in cells for word in cell.split()), default=0)
    return max(title, words, min(longest, _LEAST_TEXT))


def _pieces(title: str) -> list[str]:
    """What a title may be folded between: words, and the parts of names with underscores."""
    return re.findall(r"[^\s_]*_+|[^\s_]+", title) or [""]


def _folded(title: str, width: int) -> str:
    """A title on lines of this width."""
    lines = [""]
    for piece in re.findall(r"[^\s_]*_+|[^\s_]+|\s+", title):
        if len(lines[-1] + piece.rstrip()) > width:
            lines.append("")
        lines[-1] = (lines[-1] + piece).lstrip()
    return "\n".join(line.rstrip() for line in lines)
