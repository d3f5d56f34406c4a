"""What is wrong at one place of a derived layer."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["Problem"]


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
