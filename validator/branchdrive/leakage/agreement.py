"""Whether the rows of a group agree: such values cannot tell its actions apart.

Bit-identical replays give such features, and pass. A classifier with such scores is *inconclusive*, never a
pass: whatever it was shown, it made nothing of it.

Source: this project's choice.

Differences between what follows and what a document says.

Source: this project's choice.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["REL", "Difference", "compared", "rows_agree"]


def rows_agree(values: ArrayLike, *, atol: float = 0.0) -> bool:
    """Whether all rows of every group agree.

    Args:
        values: ``[groups, rows, ...]``, features or scores of a classifier; NaN agrees with NaN alone.
        atol: Largest difference between rows that agree, in the unit of `values`.

    Raises:
        ValueError: There is no axis of rows.
    """
    array = np.asarray(values, np.float64)
    if array.ndim < 2:
        raise ValueError(f"values have shape {list(array.shape)}, not [groups, rows, ...]")
    with np.errstate(over="ignore"):
        return bool(np.isclose(array, array[:, :1], rtol=0.0, atol=atol, equal_nan=True).all())


REL = 1e-6
"""Relative difference of numbers that are equal."""

_ABS = 1e-9


class Difference(NamedTuple):
    """One place where a document says something else than what follows.

    Attributes:
        pointer: JSON pointer of the place.
        expected: What follows.
        found: What the document says.
    """

    pointer: str
    expected: Any
    found: Any


def compared(pointer: str, expected: Any, found: Any) -> Iterator[Difference]:
    """Differences of two JSON values, numbers to a relative 1e-6."""
    if isinstance(expected, Mapping) and isinstance(found, Mapping) and expected.keys() == found.keys():
        for key in expected:
            yield from compared(f"{pointer}/{key.replace('~', '~0').replace('/', '~1')}", expected[key], found[key])
    elif isinstance(expected, list) and isinstance(found, list) and len(expected) == len(found):
        for index, (one, other) in enumerate(zip(expected, found, strict=True)):
            yield from compared(f"{pointer}/{index}", one, other)
    elif isinstance(expected, float) and type(found) in (int, float):
        if not math.isclose(expected, found, rel_tol=REL, abs_tol=_ABS):
            yield Difference(pointer, expected, found)
    elif expected != found:
        yield Difference(pointer, expected, found)
