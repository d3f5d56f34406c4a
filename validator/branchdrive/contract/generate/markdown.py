"""Markdown of the generated regions: tables, names, ranges."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from branchdrive.contract.columns import Availability, Column

__all__ = ["allowed", "code", "grid", "null"]


def grid(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Markdown table; every cell is one line."""
    lines = [header, ["---"] * len(header), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def code(names: Iterable[str]) -> str:
    """Names in back-ticks, separated by commas."""
    return ", ".join(f"`{name}`" for name in names)


def _number(value: float) -> str:
    return str(int(value)) if value == int(value) else repr(value)


def allowed(column: Column) -> str:
    """Vocabulary, pattern or range of a column; empty where anything of its type is allowed."""
    if column.values:
        return code(column.values)
    if column.pattern:
        return f"pattern `{column.pattern}`"
    match column.min, column.max:
        case None, None:
            return ""
        case low, None if low is not None:
            return f"at least {_number(low)}"
        case None, high if high is not None:
            return f"at most {_number(high)}"
        case low, high:
            return f"{_number(low)} to {_number(high)}"  # type: ignore[arg-type]


def null(available: Availability | None) -> str:
    """When a column may hold a null."""
    if available is None:
        return "never"
    return f"mask `{available.mask}`" if available.mask else f"condition `{available.when}`"
