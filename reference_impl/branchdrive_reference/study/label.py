"""Text of a dataset as people may see it: one short line of printable ASCII, whatever the dataset holds."""

from __future__ import annotations

from collections.abc import Iterable

from branchdrive.contract.text import printable

__all__ = ["LABEL_CHARACTERS", "MAX_TEXT_CHARACTERS", "label", "labels", "sentence"]

LABEL_CHARACTERS = 60
"""Longest label."""

MAX_TEXT_CHARACTERS = 1000
"""Longest text that the format allows in any column (``PATTERNS["text"]``); longer ones are no names."""

_MOST_LISTED = 40
_MOST_SENTENCE_CHARACTERS = 500


def label(text: str) -> str:
    r"""`text` escaped as reports escape it, and shortened.

    >>> label("a\x1b[31m"), len(label("a" * 1000))
    ('a\\x1b[31m', 60)
    """
    escaped = printable(text[: LABEL_CHARACTERS + 1])
    return escaped if len(escaped) <= LABEL_CHARACTERS else f"{escaped[: LABEL_CHARACTERS - 3]}..."


def labels(texts: Iterable[str]) -> str:
    """The first of many texts as labels, and how many more there are."""
    named = [label(text) for text in texts]
    more = f" and {len(named) - _MOST_LISTED:,} more" if len(named) > _MOST_LISTED else ""
    return ", ".join(named[:_MOST_LISTED]) + more


def sentence(error: Exception) -> str:
    """Message of an error on one line, escaped and shortened: it may quote a dataset or a path."""
    return printable(str(error)[:_MOST_SENTENCE_CHARACTERS])[:_MOST_SENTENCE_CHARACTERS]
