"""Comparison of a stored document with the one that follows from data.

What is wrong at one place of a derived layer.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite
from typing import Any, NamedTuple

__all__ = ["Problem", "document_problems"]

_SHOWN_CHARACTERS = 80


def document_problems(expected: Any, found: Any, *, tolerance: float = 0.0) -> list[Problem]:
    """Places where `found` is not `expected`, both JSON data, by JSON pointer.

    Args:
        expected: What follows from the data.
        found: What the layer says.
        tolerance: Numbers may differ by ``tolerance * (1 + |expected|)``; integers and fractions compare as numbers.
    """
    return list(_problems("", expected, found, tolerance))


def _problems(pointer: str, expected: Any, found: Any, tolerance: float) -> Iterator[Problem]:
    match expected, found:
        case dict(), dict():
            for key in [*expected, *(key for key in found if key not in expected)]:
                if key in expected and key in found and _is_same(expected[key], found[key]):
                    continue
                place = f"{pointer}/{str(key).replace('~', '~0').replace('/', '~1')}"
                if key in expected and key in found:
                    yield from _problems(place, expected[key], found[key], tolerance)
                else:
                    yield Problem(
                        place, *(_shown(side[key]) if key in side else "nothing" for side in (expected, found))
                    )
        case list(), list() if len(expected) == len(found):
            for i, (one, other) in enumerate(zip(expected, found, strict=True)):
                if not _is_same(one, other):
                    yield from _problems(f"{pointer}/{i}", one, other, tolerance)
        case list(), list():
            yield Problem(pointer, f"{len(expected)} entries", f"{len(found)} entries")
        case _ if _is_number(expected) and _is_number(found):
            if not abs(expected - found) <= tolerance * (1 + abs(expected)):
                yield Problem(pointer, _shown(expected), _shown(found))
        case _:
            if type(expected) is not type(found) or expected != found:
                yield Problem(pointer, _shown(expected), _shown(found))


def _is_same(one: Any, other: Any) -> bool:
    """Whether two texts or finite numbers of one type are equal, as most are; anything else takes a closer look."""
    kind = type(one)
    return kind is type(other) and (kind is str or kind is int or (kind is float and isfinite(one))) and one == other


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _shown(value: Any) -> str:
    text = ascii(value)
    return text if len(text) <= _SHOWN_CHARACTERS else f"{text[: _SHOWN_CHARACTERS - 3]}..."


class Problem(NamedTuple):
    """What is wrong at one place.

    Attributes:
        place: JSON pointer into a document, or the id of the group that it is about.
        expected: What follows from the data.
        found: What the layer says.
    """

    place: str
    expected: str
    found: str
