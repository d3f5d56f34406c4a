"""The reader of a dataset: lazy, shard by shard, and safe on a dataset of unknown origin.

Nothing is read before it is asked for, no link is followed unless the caller asks for it, and files are decoded
within the spec limits. The reader does not judge the data: `branchdrive-validate` does.

Source: spec/03-layout.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from branchdrive.contract.columns import TABLES, table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layout import shard_name
from branchdrive.contract.text import counted, quote, similar
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.descriptor_file import read_descriptor
from branchdrive.formats.folder import folder_of
from branchdrive.formats.place import Place, open_store
from branchdrive.formats.store import Store
from branchdrive.raw.group import BranchGroup
from branchdrive.raw.rollout import ROLLOUTS, canonical_key
from branchdrive.raw.shard import RowsByRollout, Shard, find_shards, rollouts_of

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Dataset", "ShardedTable", "open_dataset"]


def open_dataset(root: Place, *, follow_links: bool = False, allow: Sequence[str | Path] = ()) -> Dataset:
    """Open the dataset at `root` for reading.

    Args:
        root: The dataset folder; or a bucket, an archive, or a place that is open, see `open_store`.
        follow_links: Whether links are followed: those that stay in the dataset, and those into `allow`.
        allow: Folders that links may lead into, such as the folder of blobs of a download cache.

    Raises:
        DatasetError: There is no dataset, or its descriptor or layout cannot be read safely.
        UsageError: As `open_store`.
        PlatformError: As `open_store`.
    """
    store = open_store(root, follow_links=follow_links, allow=allow)
    if not store.is_there:
        raise DatasetError(f"{str(root)!r} is not a folder; pass the folder that holds `branchdrive.json`")
    return Dataset(store, read_descriptor(store), tuple(find_shards(store)))


@dataclass(frozen=True)
class ShardedTable:
    """One table of a dataset, decoded shard by shard while it is iterated."""

    name: str
    shards: tuple[Shard, ...]

    def __iter__(self) -> Iterator[pa.Table]:
        """The table's rows in one shard after the other, with the declared schema.

        Raises:
            DatasetError: A shard's file is missing, does not decode or has undeclared columns.
        """
        return (shard.table(self.name) for shard in self.shards)

    def __len__(self) -> int:
        return len(self.shards)

    def read(self) -> pa.Table:
        """The whole table in memory."""
        import pyarrow as pa

        return pa.concat_tables([table_schema(self.name).empty_table(), *self])

    def __repr__(self) -> str:
        return f"ShardedTable({self.name!r}, {len(self.shards)} shards)"


@dataclass(frozen=True)
class _DecodedShard:
    """A shard in memory: rows of the rollouts table, and of every stream by rollout."""

    shard: Shard
    records: list[dict[str, Any]]
    rows: Mapping[str, RowsByRollout]


class Dataset:
    """A dataset that is read lazily; made by `open_dataset`.

    Attributes:
        store: Where it is.
        descriptor: What it is and which streams it claims.
        shards: Its raw shards, by index.
    """

    def __init__(self, store: Store, descriptor: Descriptor, shards: tuple[Shard, ...]) -> None:
        self.store = store
        self.descriptor = descriptor
        self.shards = shards
        self._current: _DecodedShard | None = None

    @property
    def root(self) -> Path:
        """Its folder.

        Raises:
            UsageError: It is in no folder.
        """
        return folder_of(self.store, "this").root

    @cached_property
    def _shard_of_group(self) -> dict[str, Shard]:
        found: dict[str, Shard] = {}
        for shard in self.shards:
            for group_id in shard.table(ROLLOUTS).column("group_id").unique().to_pylist():
                if group_id in found:
                    folders = sorted(shard_name(one.index) for one in (found[group_id], shard))
                    raise DatasetError(f"{self.store}: group {group_id!r} lies in two shards, {folders}")
                found[group_id] = shard
        return found

    @property
    def groups(self) -> tuple[str, ...]:
        """Ids of all branch groups, shard by shard; reads the rollouts tables only."""
        return tuple(self._shard_of_group)

    def rollouts(self) -> pa.Table:
        """The rollouts table of the whole dataset: one row per attempt."""
        return self.table(ROLLOUTS).read()

    def table(self, name: str) -> ShardedTable:
        """The table `name`, to be iterated shard by shard.

        Raises:
            UsageError: The dataset claims no stream with this table.
        """
        if name not in self.descriptor.tables:
            raise UsageError(f"no table {name!r} in this dataset; its streams have {list(self.descriptor.tables)}")
        return ShardedTable(name, self.shards)

    def group(self, group_id: str) -> BranchGroup:
        """All rollouts of a branch group; the shard it lies in stays decoded until another one is needed.

        Raises:
            UsageError: The dataset has no such group.
            DatasetError: A file is missing, does not decode or has undeclared columns.
        """
        if group_id not in self._shard_of_group:
            raise UsageError(_unknown_group(group_id, self.groups))
        shard = self._shard_of_group[group_id]
        if self._current is None or self._current.shard != shard:
            names = [name for name in self.descriptor.tables if name != ROLLOUTS and TABLES[name].is_of_rollouts]
            self._current = _DecodedShard(shard, shard.records(), {name: shard.rows(name) for name in names})
        records = [record for record in self._current.records if record["group_id"] == group_id]
        records.sort(key=lambda record: canonical_key(record, self.descriptor))
        media = shard.media(self.descriptor)
        return BranchGroup(group_id, tuple(rollouts_of(records, self._current.rows, media)))

    def __repr__(self) -> str:
        return f"Dataset({self.descriptor.dataset_id!r}, {len(self.shards)} shards at {str(self.store)!r})"


def _unknown_group(group_id: str, groups: Sequence[str]) -> str:
    """What is said of a group that is not there: which are, the nearest names of them or the first."""
    near = similar(group_id, groups) or groups[:3]
    named = f"; there are {', '.join(map(quote, near))}" if near else ""
    more = f" and {len(groups) - len(near):,} others, all in `Dataset.groups`" if len(groups) > len(near) else ""
    return f"no group {quote(group_id)} among the {counted(len(groups), 'group')} of this dataset{named}{more}"
