"""A larger dataset for benchmarks: collected groups, repeated under new identities."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from branchdrive.contract.layout import DESCRIPTOR_FILE, RAW_DIR, shard_name
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive.formats.parquet import encode_table

__all__ = ["repeat_dataset"]

_IDENTITIES = ("group_id", "rollout_id", "nominal_rollout_id", "trigger_rollout_id")


def _renamed(table: pa.Table, prefix: str) -> pa.Table:
    for name in _IDENTITIES:
        if name in table.column_names:
            index = table.schema.get_field_index(name)
            renamed = pc.binary_join_element_wise(pa.scalar(prefix), table[name], "")
            table = table.set_column(index, table.schema.field(name), renamed)
    return table


def repeat_dataset(source: Path, target: Path, *, num_groups: int, groups_per_shard: int) -> int:
    """Write a dataset of at least `num_groups` groups to `target` by repeating those of `source`.

    Returns:
        Number of groups written: whole repetitions of the source, `groups_per_shard` or more a shard.
    """
    folders = sorted((source / RAW_DIR).iterdir())
    names = sorted(path.name for path in folders[0].iterdir())
    tables = {name: pa.concat_tables([pq.read_table(folder / name) for folder in folders]) for name in names}
    source_groups = len(pc.unique(tables["rollouts.parquet"]["group_id"]))
    copies_per_shard = -(-groups_per_shard // source_groups)
    num_shards = -(-num_groups // (copies_per_shard * source_groups))
    target.mkdir(parents=True)
    (target / DESCRIPTOR_FILE).write_bytes((source / DESCRIPTOR_FILE).read_bytes())
    for shard in range(num_shards):
        folder = target / RAW_DIR / shard_name(shard)
        folder.mkdir(parents=True)
        for name, table in tables.items():
            copies = [_renamed(table, f"s{shard}c{copy}-") for copy in range(copies_per_shard)]
            (folder / name).write_bytes(encode_table(pa.concat_tables(copies)))
    write_manifest(Folder(target), build_manifest(Folder(target)))
    return num_shards * copies_per_shard * source_groups
