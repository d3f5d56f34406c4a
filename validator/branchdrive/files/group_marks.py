"""What groups are told apart by, whatever they are called: what the ego did, and what each is like.

Source: spec/07-rules.md#response.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.files.identities import repeated_texts

__all__ = ["Outlines", "Tracks", "last_rows"]


class Tracks(NamedTuple):
    """What the ego did in attempts, each track of a group once.

    Attributes:
        names: Identities of the groups of the shard.
        group: Place of the group among them ``[tracks]``.
        digest: 64 bits of the SHA-256 of ticks, poses and speeds ``[tracks]``.
    """

    names: Sequence[str]
    group: NDArray[np.int32]
    digest: NDArray[np.uint64]

    @classmethod
    def none(cls) -> Tracks:
        """No track."""
        return cls((), np.zeros(0, np.int32), np.zeros(0, np.uint64))


class Outlines(NamedTuple):
    """What groups are like, as numbers.

    Attributes:
        names: Identities of the groups of the shard.
        group: Place of the group among them ``[outlines]``.
        values: Its numbers ``[outlines, numbers]``, NaN where something was not executed.
    """

    names: Sequence[str]
    group: NDArray[np.int32]
    values: NDArray[np.float64]

    @classmethod
    def none(cls) -> Outlines:
        """No group."""
        return cls((), np.zeros(0, np.int32), np.zeros((0, 0)))


def last_rows(shards: Sequence[Tracks] | Sequence[Outlines]) -> list[NDArray[np.bool_]]:
    """Which rows of each shard are of groups that no later shard has, too."""
    kept = [np.ones(len(shard.group), np.bool_) for shard in shards]
    for name, places in repeated_texts([shard.names for shard in shards]).items():
        for place in places[:-1]:
            kept[place] &= shards[place].group != shards[place].names.index(name)
    return kept
