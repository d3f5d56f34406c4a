"""One raw shard, read: its tables with the declared schemas, and the rollouts in it.

Source: spec/03-layout.md#folders, spec/05-raw-streams.md#tables.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from branchdrive.contract.columns import TABLES, Table
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layout import RAW_DIR, shard_index, shard_name
from branchdrive.formats.folder import folder_of
from branchdrive.formats.store import Store
from branchdrive.formats.table_file import conform, read_table
from branchdrive.raw.media.media_folder import FRAMES, MediaFolder
from branchdrive.raw.rollout import ROLLOUTS, Rollout, RolloutTables, key_columns

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["RowsByRollout", "Shard", "find_shards", "rollouts_of"]


@dataclass(frozen=True)
class Shard:
    """A raw shard of a dataset."""

    dataset: Store
    index: int

    @property
    def prefix(self) -> str:
        """The shard's folder, relative to the root."""
        return f"{RAW_DIR}/{shard_name(self.index)}"

    @property
    def folder(self) -> Path:
        """The shard's folder, for who writes there.

        Raises:
            UsageError: The dataset is in no folder.
        """
        return folder_of(self.dataset, "writing").root / self.prefix

    def __str__(self) -> str:
        return self.dataset.place(self.prefix)

    def path(self, name: str) -> str:
        """Path of the table `name`, relative to the root."""
        return f"{self.prefix}/{TABLES[name].file_name}"

    def decode(self, name: str) -> pa.Table:
        """The table `name` as stored: text as dictionaries, with the file's own metadata.

        Raises:
            DatasetError: The file is missing, does not decode, has other columns or nulls than declared, or its
                text would be larger than a decoded table may be, written out for every row.
        """
        return read_table(self.dataset, self.path(name), name)

    def table(self, name: str) -> pa.Table:
        """The table `name` with the declared schema; see `decode` for errors."""
        return conform(self.decode(name), name)

    def media(self, descriptor: Descriptor) -> MediaFolder | None:
        """Where the shard's images are; ``None`` where the descriptor claims no media stream."""
        if FRAMES not in descriptor.tables:
            return None
        return MediaFolder(self.dataset, self.prefix, descriptor.cameras_by_name)

    def rows(self, name: str) -> RowsByRollout:
        """Rows of the stream table `name`, found by rollout; see `decode` for errors."""
        return RowsByRollout(TABLES[name], self.decode(name))

    def records(self) -> list[dict[str, Any]]:
        """Rows of the rollouts table; see `decode` for errors."""
        records: list[dict[str, Any]] = self.decode(ROLLOUTS).to_pylist()
        return records


def find_shards(dataset: Store) -> list[Shard]:
    """The raw shards of a dataset, by index."""
    indices = [shard_index(name) for name in dataset.names(RAW_DIR)]
    return [Shard(dataset, index) for index in sorted(index for index in indices if index is not None)]


class RowsByRollout:
    """A stream table in which each rollout's rows are found at once, sorted by the table's key."""

    def __init__(self, declared: Table, table: pa.Table) -> None:
        self._declared = declared
        self._table = table
        ids = table.column("rollout_id").combine_chunks()
        codes = ids.indices.fill_null(-1).to_numpy(zero_copy_only=False)
        self._order = np.lexsort([*key_columns(table, declared), codes])
        sorted_codes = codes[self._order]
        self._codes = {rollout_id: code for code, rollout_id in enumerate(ids.dictionary.to_pylist())}
        code_range = np.arange(len(self._codes))
        self._starts = np.searchsorted(sorted_codes, code_range, side="left")
        self._stops = np.searchsorted(sorted_codes, code_range, side="right")

    def __getitem__(self, rollout_id: str) -> pa.Table:
        """The rollout's rows with the declared schema; none if the table lacks the rollout."""
        code = self._codes.get(rollout_id)
        rows = slice(0, 0) if code is None else slice(self._starts[code], self._stops[code])
        return conform(self._table.take(self._order[rows]), self._declared.name)


def rollouts_of(
    records: Iterable[dict[str, Any]], rows: Mapping[str, RowsByRollout], media: MediaFolder | None = None
) -> list[Rollout]:
    """The rollouts of `records`, with their rows of every table in `rows`, and their images in `media`."""
    return [
        Rollout(record, RolloutTables({name: table[record["rollout_id"]] for name, table in rows.items()}), media)
        for record in records
    ]
