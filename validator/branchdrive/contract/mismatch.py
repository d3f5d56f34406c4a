"""What a rule finds: at one place something was expected, and something else is there.

Source: spec/07-rules.md#findings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["MAX_KEPT", "Check", "Location", "Mask", "Mismatch", "Mismatches", "PreconditionError", "Stretch"]

MAX_KEPT = 100
"""Mismatches of a rule that are kept; counts stay exact."""

Location: TypeAlias = dict[str, str | int]
"""Parts of a place: file, pointer, table, column, key of a row, group_id, rollout_id, tick, actor_id, camera.

A pointer is a JSON pointer (RFC 6901) into the document, and ``/`` stands for the whole of it.
"""

Mask: TypeAlias = NDArray[np.bool_]


class PreconditionError(Exception):
    """A rule cannot be judged, because something it needs is missing or broken; other rules report that."""


@dataclass(frozen=True)
class Mismatch:
    """At one place something else was found than was expected.

    Attributes:
        location: The place, as far as it is known where the mismatch is found; who knows more adds it, see `within`.
        expected: What the clause demands there, as text.
        found: What the dataset has there, as text.
        count: Mismatching items that this one stands for.
        group_id: The branch group that it is about, where the location has it not.
        last_tick: The last tick of these items, of which the location has the first; ``None`` where it is not known.
        branch_tick: That of the attempt; ``None`` where there is none.
    """

    location: Location
    expected: str
    found: str
    count: int = 1
    group_id: str | None = None
    last_tick: int | None = None
    branch_tick: int | None = None

    def within(self, location: Location) -> Mismatch:
        """This mismatch at a place inside of `location`, whose parts come first: a file, a table, a subject."""
        return replace(self, location={**location, **self.location})


@dataclass
class Mismatches:
    """Mismatches of which there may be millions: how many there are, and the first of them.

    Attributes:
        num: How many.
        first: At most `MAX_KEPT` of them.
    """

    num: int = 0
    first: list[Mismatch] = field(default_factory=list)

    def add(self, mismatch: Mismatch) -> None:
        """Note one more."""
        self.note([0], lambda _: mismatch)

    def note(self, places: Sequence[int], describe: Callable[[int], Mismatch]) -> None:
        """Note one more at each of some places; those that are kept are described."""
        self.first += [describe(place) for place in places[: max(MAX_KEPT - self.num, 0)]]
        self.num += len(places)


@dataclass(frozen=True)
class Stretch:
    """Ticks between which rows of a table are at fault, by attempt of a shard.

    Attributes:
        table: The table.
        first: The first such tick of each attempt, `UNKNOWN` where it is not known, ``[rollouts]``.
        last: The last.
        is_there: Attempts with such rows ``[rollouts]``.
    """

    UNKNOWN: ClassVar[int] = -1

    table: str
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    is_there: Mask

    def last_tick(self, attempt: int, location: Location) -> int | None:
        """The last tick of an attempt of which a mismatch tells the first; ``None`` where it is of other rows."""
        here = self.table, int(self.first[attempt])
        is_its = self.is_there[attempt] and (location.get("table"), location.get("tick")) == here
        return int(self.last[attempt]) if is_its else None


@dataclass(frozen=True)
class Check:
    """What a rule examined, or a part of it, and which of its subjects mismatch.

    Attributes:
        examined: Subjects looked at: how many, or a mask of the attempts or groups of a shard.
        bad: Subjects that mismatch, ascending: rows of `table`, or indices of attempts, groups or of a list.
        mismatch: The mismatch of one of them; called for those alone that a report keeps.
        table: Table whose rows are the subjects; ``None`` where they are no rows of a shard or a layer.
        stretches: Of attempts that mismatch, which rows do, as far as that is known.
    """

    examined: int | Mask
    bad: NDArray[np.intp]
    mismatch: Callable[[int], Mismatch]
    table: str | None = None
    stretches: tuple[Stretch, ...] = ()

    @classmethod
    def of(cls, examined: int, mismatches: Iterable[Mismatch] = ()) -> Check:
        """Check of files, documents or rows with one mismatch for every subject that has one."""
        found = tuple(mismatches)
        return cls(max(examined, len(found)), np.arange(len(found)), found.__getitem__)

    @classmethod
    def of_many(cls, examined: int, mismatches: Iterable[Mismatches]) -> Check:
        """Check of files or rows of which each may have many mismatches."""
        found = list(mismatches)
        first = [mismatch for of_one in found for mismatch in of_one.first]
        num = sum(of_one.num for of_one in found)
        return cls(max(examined, num), np.arange(num), first.__getitem__)

    @classmethod
    def of_rows(
        cls,
        table: str,
        column: str | None,
        examined: int,
        bad: NDArray[np.intp],
        describe: Callable[[int], tuple[str, str]],
    ) -> Check:
        """Check of rows of a table.

        Args:
            table: The table.
            column: Column at fault, if it is one.
            examined: Rows looked at.
            bad: Mismatching rows, ascending.
            describe: Expected and found text of one of them.
        """
        location: Location = {"column": column} if column else {}
        return cls(examined, bad, lambda row: Mismatch(dict(location), *describe(row)), table)

    @classmethod
    def of_subjects(cls, examined: Mask, bad: Mask, mismatch: Callable[[int], Mismatch], *stretches: Stretch) -> Check:
        """Check of attempts or groups of a shard, both as masks; `bad` is a subset of `examined`."""
        return cls(examined, np.flatnonzero(bad), mismatch, stretches=stretches)

    @classmethod
    def of_any(cls, first: Check, *others: Check) -> Check:
        """Check of attempts or groups by several: who any of them looked at is examined.

        A subject's mismatch is that of the first check that has one.
        """
        homes = {int(i): check for check in (*others[::-1], first) for i in check.bad}
        examined = np.logical_or.reduce([check.mask for check in (first, *others)])
        stretches = tuple(stretch for check in (first, *others) for stretch in check.stretches)
        bad = np.array(sorted(homes), np.intp)
        return cls(examined, bad, lambda i: homes[i].mismatch(i), stretches=stretches)

    @property
    def mask(self) -> Mask:
        """Attempts or groups that were looked at.

        Raises:
            TypeError: The subjects are neither.
        """
        if isinstance(self.examined, int):
            raise TypeError("subjects that are counted have no mask")
        return self.examined

    @property
    def num_examined(self) -> int:
        """Subjects looked at."""
        return self.examined if isinstance(self.examined, int) else int(self.examined.sum())

    @property
    def num_subjects(self) -> int:
        """Subjects there are, looked at or not."""
        return self.examined if isinstance(self.examined, int) else len(self.examined)
