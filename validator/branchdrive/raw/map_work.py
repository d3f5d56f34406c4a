"""How much a shard compares with its maps, which has a limit: whatever a map holds, looking through it ends.

What is more ends the rule that asked for it, and is a finding on the map.
Source: spec/05-raw-streams.md#map, spec/09-security.md#limits.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from branchdrive.contract.limits import spec_limits
from branchdrive.contract.mismatch import PreconditionError
from branchdrive.driving.surface import TooLargeError, Work
from branchdrive.raw.shard_view import ShardView

__all__ = ["map_excess", "within_limits"]


class _Comparisons(Work):
    """Pairs that a shard may still compare, and how its maps exceed the limits, if they do."""

    def __init__(self) -> None:
        super().__init__(spec_limits().max_map_pairs)
        self.excess: str | None = None


def _comparisons(_: ShardView) -> _Comparisons:
    return _Comparisons()


@contextmanager
def within_limits(view: ShardView) -> Iterator[Work]:
    """The work that is left for a shard's maps.

    Raises:
        PreconditionError: A map exceeds the limits.
    """
    work = view.cached(_comparisons)
    try:
        yield work
    except TooLargeError as error:
        work.excess = str(error)
        raise PreconditionError(f"the map {error}; keep what lies near the rollouts") from None


def map_excess(view: ShardView) -> str | None:
    """How the maps of a shard exceed the limits, as far as they were looked through; ``None`` where they do not."""
    return view.cached(_comparisons).excess
