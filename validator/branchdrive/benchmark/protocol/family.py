"""Families of tests, and their p-values adjusted by Holm's method.

Which tests form a family, and how many families there are, is declared by the protocol: the size of a family is
part of the result. A test may belong to several.

A p-value that is the smallest its permutations allow is a bound, and so is every adjusted one that Holm's
running maximum takes from it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from branchdrive.statistics.holm import holm

__all__ = ["Adjusted", "Family", "adjust"]


class Family(NamedTuple):
    """A declared family: its name, and the names of its tests."""

    name: str
    members: tuple[str, ...]


class Adjusted(NamedTuple):
    """An adjusted p-value; `is_bound` where it is to be printed with "<="."""

    p: float
    is_bound: bool


def adjust(
    families: Sequence[Family], p_values: Mapping[str, float], *, smallest: Collection[str] = ()
) -> dict[str, dict[str, Adjusted]]:
    """Adjusted p-values by family and test, in the declared order.

    Args:
        families: What is declared.
        p_values: By test; those that no family names are not used.
        smallest: Tests whose p-value is the smallest that their permutations allow.

    Raises:
        ValueError: Two families share a name, a family is empty or names a test twice, or a test has no p-value.
    """
    names = [family.name for family in families]
    if len(set(names)) < len(names):
        raise ValueError(f"two families share a name: {names!r}")
    return {family.name: _adjusted(family, p_values, smallest) for family in families}


def _adjusted(family: Family, p_values: Mapping[str, float], smallest: Collection[str]) -> dict[str, Adjusted]:
    if not family.members or len(set(family.members)) < len(family.members):
        raise ValueError(f"family {family.name!r} is empty or names a test twice: {list(family.members)!r}")
    missing = [member for member in family.members if member not in p_values]
    if missing:
        raise ValueError(f"family {family.name!r} names the test {missing[0]!r}, which has no p-value")
    adjusted: list[float] = holm([p_values[member] for member in family.members]).tolist()
    bounds = {p for member, p in zip(family.members, adjusted, strict=True) if member in smallest}
    return {member: Adjusted(p, p in bounds) for member, p in zip(family.members, adjusted, strict=True)}
