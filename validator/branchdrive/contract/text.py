"""Values as text for people: safe to print whatever a dataset holds."""

from __future__ import annotations

import traceback
from collections.abc import Collection, Iterable
from difflib import get_close_matches

__all__ = [
    "NONE", "count_text", "counted", "failure_text", "listed", "nearest", "one_line", "percent", "printable", "quote",
    "similar", "size_text",
]  # fmt: skip

NONE = "-"
"""Stands where a value is not defined."""

MAX_QUOTED = 160
"""Characters of a quoted value in a finding."""

_MAX_LINE = 500
"""Characters of a line of a traceback, whose message may quote a value."""

_UNITS = ("byte", "KiB", "MiB", "GiB", "TiB")


def printable(text: str) -> str:
    """`text` on one line of printable ASCII, every other character escaped: safe on any terminal."""
    return "".join(c if " " <= c <= "~" else ascii(c)[1:-1] for c in text)


def failure_text(place: str) -> str:
    """The exception that is being handled, with its traceback, in printable lines."""
    lines = f"{place}:\n{traceback.format_exc()}".rstrip().split("\n")
    return "\n".join(printable(line[:_MAX_LINE]) for line in lines)


def one_line(text: str) -> str:
    """`text` on one line, with a blank for every character that has no shape."""
    return "".join(char if char.isprintable() else " " for char in text)


def quote(value: object) -> str:
    """`value` by repr, shortened, in printable ASCII: a report must be safe to print whatever a dataset holds.

    A float32 has the shortest text that tells it from every other float32.
    """
    if getattr(value, "dtype", None) == "float32" and getattr(value, "ndim", 1) == 0:
        return str(value)
    text = ascii(value.item() if hasattr(value, "item") and getattr(value, "ndim", 1) == 0 else value)
    return text if len(text) <= MAX_QUOTED else text[: MAX_QUOTED - 3] + "..."


def percent(share: float, digits: int = 2) -> str:
    """A share as per cent; what is not all is never rounded to 100, what is not nothing never to 0."""
    least = 0.51 * 10.0 ** -(digits + 2)
    clipped = min(max(share, least), 1 - least) if 0 < share < 1 else share
    return f"{100 * clipped:.{digits}f}%"


def count_text(count: int | None) -> str:
    """A count with its thousands apart."""
    return NONE if count is None else f"{count:,}"


def listed(names: Iterable[object]) -> str:
    """Names in back-ticks, with commas."""
    return ", ".join(f"`{printable(str(name))}`" for name in names)


def similar(name: str, names: Collection[str]) -> list[str]:
    """Up to three of `names` that begin with `name` or, of three letters or more, begin it, else that are like it."""
    folded, wanted = {each.casefold(): each for each in names}, name.casefold()
    begun = [
        each for each in folded if name and (each.startswith(wanted) or (len(each) > 2 and wanted.startswith(each)))
    ]
    return [folded[each] for each in begun[:3] or get_close_matches(wanted, folded, n=3, cutoff=0.5)]


def nearest(name: str, names: Collection[str]) -> str:
    """Names to answer one with that is none of `names`: those that are `similar`, else all of them."""
    close = similar(name, names)
    return f"did you mean {' or '.join(map(quote, close))}?" if close else f"there are {listed(names) or 'none'}"


def counted(count: int, noun: str) -> str:
    """A count of things, `noun` in the singular."""
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"


def size_text(num_bytes: int) -> str:
    """Bytes in the largest unit of which there is one at least.

    >>> size_text(512), size_text(5_452_595)
    ('512 bytes', '5.2 MiB')
    """
    size, place = float(num_bytes), 0
    while size >= 1024 and place < len(_UNITS) - 1:
        size, place = size / 1024, place + 1
    return counted(num_bytes, "byte") if not place else f"{size:.1f} {_UNITS[place]}"
