"""Mismatches as tests compare them."""

from __future__ import annotations

from collections.abc import Iterable

from branchdrive.contract.mismatch import Mismatch

__all__ = ["pointers", "rows"]


def pointers(found: Iterable[Mismatch]) -> list[str]:
    """JSON pointers of mismatches, in order."""
    return [str(mismatch.location["pointer"]) for mismatch in found]


def rows(found: Iterable[Mismatch]) -> list[tuple[str | int, ...]]:
    """Parts of the location, then expected and found text of mismatches, in order."""
    return [(*mismatch.location.values(), mismatch.expected, mismatch.found) for mismatch in found]
