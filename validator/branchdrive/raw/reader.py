"""The reader of a dataset: lazy, shard by shard, and safe on a dataset of unknown origin.

Nothing is read before it is asked for, no link is followed unless the caller asks for it, and files are decoded
within the spec limits. The reader does not judge the data: `branchdrive-validate` does.

Source: spec/03-layout.md.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from branchdrive.contract.columns import TABLES, table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layout import shard_name
from branchdrive.contract.text import counted, nearest, quote, similar
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.descriptor_file import read_descriptor
from branchdrive.formats.folder import folder_of
from branchdrive.formats.place import Place, open_store
from branchdrive.formats.store import Store
from branchdrive.raw.contexts import Context, chosen_groups, contexts_of_quality, contexts_of_shard
from branchdrive.raw.group import BranchGroup
from branchdrive.raw.rollout import ROLLOUTS, canonical_key
from branchdrive.raw.shard import RowsByRollout, Shard, find_shards, rollouts_of
from branchdrive.tables.data_frame import to_pandas, to_polars
from branchdrive.text.html import html_of
from branchdrive.text.table import Column, Table

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
    groups: frozenset[str] | None = None
    """Groups whose rows are kept; all where it is ``None``. A town's map is kept whole."""

    def __iter__(self) -> Iterator[pa.Table]:
        """The table's rows in one shard after the other, with the declared schema.

        Raises:
            DatasetError: A shard's file is missing, does not decode or has undeclared columns.
        """
        return (self._kept(shard, shard.table(self.name)) for shard in self.shards)

    def _kept(self, shard: Shard, rows: pa.Table) -> pa.Table:
        if self.groups is None or not TABLES[self.name].is_of_rollouts:
            return rows
        import pyarrow as pa
        import pyarrow.compute as pc

        rollouts = rows if self.name == ROLLOUTS else shard.table(ROLLOUTS)
        is_kept = pc.is_in(rollouts["group_id"], pa.array(sorted(self.groups)))
        return rows.filter(pc.is_in(rows["rollout_id"], rollouts.filter(is_kept)["rollout_id"].combine_chunks()))

    def __len__(self) -> int:
        return len(self.shards)

    def read(self) -> pa.Table:
        """The whole table in memory."""
        import pyarrow as pa

        return pa.concat_tables([table_schema(self.name).empty_table(), *self])

    def to_pandas(self) -> Any:
        """The whole table as a `pandas.DataFrame`."""
        return to_pandas(self.read())

    def to_polars(self) -> Any:
        """The whole table as a `polars.DataFrame`."""
        return to_polars(self.read())

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
        self._selected: frozenset[str] | None = None

    @property
    def root(self) -> Path:
        """Its folder.

        Raises:
            UsageError: It is in no folder.
        """
        return folder_of(self.store, "this").root

    @cached_property
    def _shard_of_group(self) -> dict[str, Shard]:
        found = self._shard_of_any_group
        return found if self._selected is None else {group: found[group] for group in found if group in self._selected}

    @cached_property
    def _shard_of_any_group(self) -> dict[str, Shard]:
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

    @cached_property
    def contexts(self) -> dict[str, Context]:
        """What tells the groups apart, by group id: columns that their attempts share, and those of `group_quality`.

        Raises:
            DatasetError: A table is missing or does not decode.
        """
        shared = {group: context for shard in self.shards for group, context in contexts_of_shard(shard).items()}
        judged = contexts_of_quality(self.shards[0].dataset, self.descriptor) if self.shards else {}
        return {group_id: {**judged.get(group_id, {}), **shared[group_id]} for group_id in self.groups}

    def select(self, **wanted: Any) -> Dataset:
        """The same dataset with some of its groups, in `groups`, `table` and everything else.

        >>> def cut_ins(dataset: Dataset) -> Dataset:
        ...     return dataset.select(scenario_type=["HighwayCutIn", "ParkingCutIn"], partition="train")

        Args:
            wanted: By column of `contexts`, the value that a group must have, or several of which it must have one.

        Raises:
            UsageError: Groups have no such column, or none has such a text in it; the message names those that are.
        """
        chosen = frozenset(chosen_groups(self.contexts, wanted))
        shards = dict.fromkeys(self._shard_of_group[group_id] for group_id in self.groups if group_id in chosen)
        selected = Dataset(self.store, self.descriptor, tuple(shards))
        selected._selected = chosen
        return selected

    def __iter__(self) -> Iterator[BranchGroup]:
        return map(self.group, self.groups)

    def __len__(self) -> int:
        return len(self.groups)

    def rollouts(self) -> pa.Table:
        """The rollouts table of the whole dataset: one row per attempt."""
        return self.table(ROLLOUTS).read()

    def table(self, name: str) -> ShardedTable:
        """The table `name`, to be iterated shard by shard.

        Raises:
            UsageError: The dataset claims no stream with this table.
        """
        if name not in self.descriptor.tables:
            raise UsageError(f"no table {quote(name)} in this dataset; {nearest(name, self.descriptor.tables)}")
        return ShardedTable(name, self.shards, self._selected)

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

    def _repr_html_(self) -> str:
        about = self.descriptor
        facts = [
            ("title", about.title), ("licence", about.licence), ("layers", ", ".join(about.layers)),
            ("streams", ", ".join(about.streams)), ("at", str(self.store)), ("groups", f"{len(self):,}"),
        ]  # fmt: skip
        counts = Counter(str(context["scenario_type"]) for context in self.contexts.values())
        columns = [Column.name("scenario type"), Column("groups")]
        table = Table("Groups", columns, [[name, f"{count:,}"] for name, count in counts.most_common()])
        return html_of(f"{about.dataset_id} {about.dataset_version}", facts, [table])

    def __repr__(self) -> str:
        return f"Dataset({self.descriptor.dataset_id!r}, {len(self.shards)} shards at {str(self.store)!r})"


def _unknown_group(group_id: str, groups: Sequence[str]) -> str:
    """What is said of a group that is not there: which are, the nearest names of them or the first."""
    near = similar(group_id, groups) or groups[:3]
    named = f"; there are {', '.join(map(quote, near))}" if near else ""
    more = f" and {len(groups) - len(near):,} others, all in `Dataset.groups`" if len(groups) > len(near) else ""
    return f"no group {quote(group_id)} among the {counted(len(groups), 'group')} of this dataset{named}{more}"
