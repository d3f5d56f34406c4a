"""Comparison of what is stored with what follows from data: which numbers agree, and where two documents differ.

A stored number agrees with the recomputed ``x`` where it lies within ``tolerance (1 + |x|)`` of it: the same formula
on another machine gives other last bits and sums in another order. Infinity agrees with itself alone, and NaN with
nothing. Columns of tables are compared by the same measure, see `branchdrive.layers.compare`.

Source: spec/10-layers.md#derivation.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, isfinite
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mask, Mismatch

__all__ = ["TOLERANCE", "agree", "document_mismatches", "is_number"]

TOLERANCE = 1e-9
"""Largest distance between a stored and a recomputed real number ``x``, in units of ``1 + |x|``."""

_SHOWN_CHARACTERS = 80


@overload
def agree(expected: float, found: float, tolerance: float = TOLERANCE) -> bool: ...
@overload
def agree(expected: NDArray[Any], found: NDArray[Any], tolerance: float = TOLERANCE) -> Mask: ...
def agree(expected: Any, found: Any, tolerance: float = TOLERANCE) -> bool | Mask:
    """Whether stored numbers agree with recomputed ones, two numbers or two arrays of one shape.

    ``found = expected  or  |found - expected| <= tolerance (1 + |expected|) < inf``

    Args:
        expected: What follows from data.
        found: What is stored.
        tolerance: Largest distance in units of ``1 + |expected|``.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        largest = tolerance * (1 + abs(expected))
        agreeing: bool | Mask = (found == expected) | ((abs(found - expected) <= largest) & (largest < inf))
    return agreeing


def document_mismatches(expected: Any, found: Any, *, tolerance: float = 0.0, pointer: str = "") -> Iterator[Mismatch]:
    """Places where `found` is not `expected`, both JSON data, by JSON pointer.

    Types are those of JSON: ``false`` is not 0, and an integer is the fraction of its value.

    Args:
        expected: What follows from the data.
        found: What the document says.
        tolerance: Largest distance of numbers that `agree`; 0 where they are copied or counted.
        pointer: Where both lie, if they are a part of the document.
    """
    match expected, found:
        case dict(), dict():
            for key in [*expected, *(key for key in found if key not in expected)]:
                if key in expected and key in found and _is_same(expected[key], found[key]):
                    continue
                place = f"{pointer}/{str(key).replace('~', '~0').replace('/', '~1')}"
                if key in expected and key in found:
                    yield from document_mismatches(expected[key], found[key], tolerance=tolerance, pointer=place)
                else:
                    one, other = (_format_value(side[key]) if key in side else "nothing" for side in (expected, found))
                    yield Mismatch({"pointer": place}, one, other)
        case list(), list() if len(expected) == len(found):
            for i, (one, other) in enumerate(zip(expected, found, strict=True)):
                if not _is_same(one, other):
                    yield from document_mismatches(one, other, tolerance=tolerance, pointer=f"{pointer}/{i}")
        case list(), list():
            yield Mismatch({"pointer": pointer or "/"}, f"{len(expected)} entries", f"{len(found)} entries")
        case _ if is_number(expected) and is_number(found):
            if not agree(expected, found, tolerance):
                yield Mismatch({"pointer": pointer or "/"}, _format_value(expected), _format_value(found))
        case _:
            if type(expected) is not type(found) or expected != found:
                yield Mismatch({"pointer": pointer or "/"}, _format_value(expected), _format_value(found))


def _is_same(one: Any, other: Any) -> bool:
    """Whether two texts or finite numbers of one type are equal, as most are; anything else takes a closer look."""
    kind = type(one)
    return kind is type(other) and (kind is str or kind is int or (kind is float and isfinite(one))) and one == other


def is_number(value: Any) -> bool:
    """Whether JSON data is a number; ``true`` and ``false`` are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _format_value(value: Any) -> str:
    text = ascii(value)
    return text if len(text) <= _SHOWN_CHARACTERS else f"{text[: _SHOWN_CHARACTERS - 3]}..."
