"""A part of a collection, for one of several machines: shards take turns among the parts.

Part K of N has the shards K - 1, K - 1 + N, K - 1 + 2 N and so on, with all their groups, however many groups there
are. A shard of a part is that of the whole collection, with its number and its bytes.

Source: spec/03-layout.md#merging.
"""

from __future__ import annotations

import re
from argparse import ArgumentTypeError
from typing import NamedTuple, Self

from branchdrive.contract.text import counted
from branchdrive.errors import UsageError

__all__ = ["WHOLE", "Part"]

_FORM = re.compile(r"([1-9][0-9]{0,5})/([1-9][0-9]{0,5})")


class Part(NamedTuple):
    """Part `number` of `num_parts`; numbers begin at 1."""

    number: int
    num_parts: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """The part that ``K/N`` names, for `argparse`.

        >>> Part.parse("2/3")
        Part(number=2, num_parts=3)

        Raises:
            ArgumentTypeError: It names none.
        """
        match = _FORM.fullmatch(text)
        part = cls(int(match[1]), int(match[2])) if match else None
        if part is None or part.number > part.num_parts:
            raise ArgumentTypeError(f"{text!r} is not K/N, part K of N, such as 1/3")
        return part

    def __str__(self) -> str:
        return f"{self.number}/{self.num_parts}"

    def places(self, num_groups: int, groups_per_shard: int) -> list[int]:
        """Places of the groups of this part, of `num_groups`, ascending.

        >>> Part(2, 3).places(10, groups_per_shard=2)
        [2, 3, 8, 9]

        Raises:
            UsageError: There are none, or there is no such part.
        """
        if not 1 <= self.number <= self.num_parts:
            raise UsageError(f"part: parts of {self.num_parts} are 1 to {self.num_parts}; found {self.number}")
        starts = range((self.number - 1) * groups_per_shard, num_groups, self.num_parts * groups_per_shard)
        if not starts:
            raise UsageError(
                f"part {self}: has whole shards of {groups_per_shard} groups, and {counted(num_groups, 'group')} leave "
                f"none for it; ask for at most {-(-num_groups // groups_per_shard)} parts"
            )
        return [place for start in starts for place in range(start, min(start + groups_per_shard, num_groups))]


WHOLE = Part(1, 1)
"""The whole collection."""
