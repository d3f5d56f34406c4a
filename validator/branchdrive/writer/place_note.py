"""The note of places in a rollouts file: where its writer put the groups of a shard; readers ignore it.

A shard may have got another number since: it was merged with others. What a note says of the places within the shard
still holds, so that a group lies at place ``shard * groups_per_shard + noted place % groups_per_shard``.

Source: spec/03-layout.md#places.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from branchdrive.errors import DatasetError

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["PlaceNote"]

_KEY = b"branchdrive.places"


@dataclass(frozen=True)
class PlaceNote:
    """What is noted of a shard.

    Attributes:
        groups_per_shard: Places of one shard.
        places: Place of every group of the shard when it was written, by group id.
    """

    groups_per_shard: int
    places: Mapping[str, int]

    def add_to(self, rollouts: pa.Table) -> pa.Table:
        """The rollouts table with this note."""
        note = {"groups_per_shard": self.groups_per_shard, "places": dict(self.places)}
        return rollouts.replace_schema_metadata({_KEY: json.dumps(note, sort_keys=True).encode()})

    @classmethod
    def of(cls, rollouts: pa.Table, where: str) -> Self | None:
        """The note of a rollouts table; ``None`` where another program wrote it.

        Args:
            rollouts: The table, with the metadata of its file.
            where: The file, for messages.

        Raises:
            DatasetError: The note is damaged, or not of the groups of the table.
        """
        metadata = rollouts.schema.metadata or {}
        if _KEY not in metadata:
            return None
        try:
            note = json.loads(metadata[_KEY])
            found = cls(note["groups_per_shard"], note["places"])
            is_whole = found._is_of(set(rollouts.column("group_id").unique().to_pylist()))
        except (ValueError, RecursionError, KeyError, TypeError, AttributeError):
            is_whole = False
        if not is_whole:
            raise DatasetError(f"{where}: the writer's note of places is damaged; restore the file")
        return found

    def _is_of(self, group_ids: Collection[str]) -> bool:
        places, size = list(self.places.values()), self.groups_per_shard
        if not all(type(number) is int for number in (*places, size)) or size < 1 or min(places, default=0) < 0:
            return False
        return self.places.keys() == group_ids and len({place % size for place in places}) == len(places)

    def in_shard(self, index: int) -> dict[str, int]:
        """Places of the groups in a dataset in which the shard has the number `index`."""
        size = self.groups_per_shard
        return {group_id: index * size + place % size for group_id, place in self.places.items()}
