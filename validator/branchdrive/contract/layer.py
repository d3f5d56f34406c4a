"""The derived layers, as `schemas/v0.1/layers.json` declares them: their tables and documents, in order.

Every layer is derived from the ones before it. Source: paper, "Release Structure"; spec/10-layers.md#layers.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

from branchdrive.contract.columns import LAYER_TABLES, Table
from branchdrive.contract.layout import RAW_DIR, shard_index
from branchdrive.contract.resources import load_resource

__all__ = [
    "LAYERS", "PART_SHARDS", "Layer", "LayerDocument", "TableFile", "layer_of_table", "part_of", "part_of_shard",
    "paths_by_table", "table_file", "table_path", "table_paths", "table_pattern",
]  # fmt: skip

PART_SHARDS: int = load_resource("layers.json")["part_shards"]
"""Shards whose groups share the parts of derived tables."""

_PART = re.compile(r"(.+)-([0-9]{5}|[1-9][0-9]{5,7})\.parquet")


@dataclass(frozen=True)
class LayerDocument:
    """One document of a layer.

    Attributes:
        name: File name in the layer's folder.
        schema: JSON Schema that it conforms to.
        title: What it says, one sentence.
        optional: Whether the layer may lack it.
    """

    name: str
    schema: str
    title: str
    optional: bool = False


@dataclass(frozen=True)
class Layer:
    """One derived layer: a folder of tables and documents.

    Attributes:
        name: Its name and its folder's.
        title: What it holds, one sentence.
        after: Layer that it is derived from, with those before it.
        documents: Its documents by file name.
        tables: Its tables by name.
        free: Regular expressions of the paths, relative to its folder, that further files may have.
    """

    name: str
    title: str
    after: str
    documents: Mapping[str, LayerDocument]
    tables: Mapping[str, Table]
    free: tuple[str, ...] = ()

    def num_required(self, there: Collection[str]) -> int:
        """Documents and tables that the layer must have beside the files that are `there`, those among them too.

        A table of partitions counts once for each.
        """
        num_documents = sum(not document.optional for document in self.documents.values())
        return num_documents + len(self._required_tables(self._found(there)))

    def missing(self, there: Collection[str]) -> tuple[str, ...]:
        """Paths relative to the root of files that the layer must have and that are not `there`.

        Of a table, or of a partition of it, that has no file at all, the first part is missing; whether further parts
        are follows from their rows.
        """
        required = (f"{self.name}/{name}" for name, document in self.documents.items() if not document.optional)
        found = self._found(there)
        tables = (table_path(*one) for one in self._required_tables(found) if one not in found)
        return (*(path for path in required if path not in there), *tables)

    def _found(self, there: Collection[str]) -> set[tuple[str, str | None]]:
        """Tables of the layer, with the partition of their rows, that have a file `there`."""
        files = (table_file(path) for path in there if path.startswith(f"{self.name}/"))
        return {file[:2] for file in files if file}

    def _required_tables(self, found: Collection[tuple[str, str | None]]) -> list[tuple[str, str | None]]:
        """Tables that the layer must have, once for each partition: an optional one where any of it is `found`."""
        begun = {name for name, _ in found}
        tables = (table for table in self.tables.values() if not table.optional or table.name in begun)
        return [(table.name, partition) for table in tables for partition in table.partitions or (None,)]

    def own(self, paths: Iterable[str]) -> tuple[str, ...]:
        """Those of the `paths`, relative to the root, that documents and files of tables of the layer may have."""
        return tuple(path for path in paths if self.admits(path))

    def admits(self, path: str) -> bool:
        """Whether `path`, relative to the root, is one of a document or of a file of a table of the layer.

        >>> LAYERS["canonical"].admits("canonical/records-00012.parquet")
        True
        """
        if not path.startswith(f"{self.name}/"):
            return False
        return table_file(path) is not None or path.removeprefix(f"{self.name}/") in self.documents

    @property
    def former_files(self) -> tuple[str, ...]:
        """Paths, relative to the root, of tables that earlier drafts stored in one file, or one for each partition."""
        tables = (table for table in self.tables.values() if table.is_of_groups)
        stems = (_stem(table.name, partition) for table in tables for partition in table.partitions or (None,))
        return tuple(f"{stem}.parquet" for stem in stems)

    def admits_free(self, path: str) -> bool:
        """Whether `path`, relative to the root, is one of the further files that the layer may have.

        >>> LAYERS["benchmark"].admits_free("benchmark/checkpoints/M3-seed11.safetensors")
        True
        """
        inside = path.removeprefix(f"{self.name}/")
        return inside != path and any(re.search(rule.removesuffix("$") + r"\Z", inside) for rule in self.free)

    def holds_folder(self, path: str) -> bool:
        """Whether `path`, relative to the root, is a folder of further files."""
        inside = path.removeprefix(f"{self.name}/")
        return inside != path and any(rule.startswith(f"^{inside}/") for rule in self.free)


def _layers() -> Mapping[str, Layer]:
    return MappingProxyType(
        {
            name: Layer(
                name,
                declared["title"],
                declared["after"],
                MappingProxyType({d: LayerDocument(d, **about) for d, about in declared["documents"].items()}),
                MappingProxyType({table: LAYER_TABLES[table] for table in declared["tables"]}),
                tuple(declared.get("free", ())),
            )
            for name, declared in load_resource("layers.json")["layers"].items()
        }
    )


LAYERS: Mapping[str, Layer] = _layers()
"""Every derived layer by name, in the order of derivation."""

_LAYER_OF_TABLE = {table: layer.name for layer in LAYERS.values() for table in layer.tables}


def layer_of_table(table: str) -> str:
    """Name of the layer that holds `table`.

    Raises:
        KeyError: No derived layer has such a table.
    """
    return _LAYER_OF_TABLE[table]


class TableFile(NamedTuple):
    """Which rows of which table of a derived layer a file holds.

    Attributes:
        table: Name of the table.
        partition: Partition of the rows; ``None`` where the table has none.
        part: Number of the part; ``None`` of a table that is one file.
    """

    table: str
    partition: str | None = None
    part: int | None = None


def _stem(table: str, partition: str | None) -> str:
    return f"{layer_of_table(table)}/{table}" + (f"-{partition}" if partition is not None else "")


_FILE_OF_STEM = {
    _stem(table.name, partition): TableFile(table.name, partition)
    for table in LAYER_TABLES.values()
    for partition in table.partitions or (None,)
}


def table_file(path: str) -> TableFile | None:
    """What the file at `path`, relative to the root, holds of a table of a derived layer; ``None`` of other files.

    >>> table_file("model/scalars-train-00012.parquet")
    TableFile(table='scalars', partition='train', part=12)
    >>> table_file("model/actions.parquet"), table_file("model/scalars-00000.parquet")
    (TableFile(table='actions', partition=None, part=None), None)
    """
    part = _PART.fullmatch(path)
    found = _FILE_OF_STEM.get(part[1] if part else path.removesuffix(".parquet"))
    if found is None or LAYER_TABLES[found.table].is_of_groups != bool(part):
        return None
    if part:
        return found._replace(part=int(part[2]))
    return found if path.endswith(".parquet") else None


def table_path(table: str, partition: str | None = None, part: int = 0) -> str:
    """Path of a file of a layer's table relative to the root.

    >>> table_path("actions"), table_path("scalars", "train", 12)
    ('model/actions.parquet', 'model/scalars-train-00012.parquet')

    Args:
        table: Its name.
        partition: Partition of the rows, of a table that has them.
        part: Number of the part, of a table with rows of groups.

    Raises:
        KeyError: No derived layer has such a table, or it has no such partition.
    """
    declared = LAYER_TABLES[table]
    if partition not in (declared.partitions or (None,)):
        raise KeyError(partition)
    return _stem(table, partition) + (f"-{part:05d}" if declared.is_of_groups else "") + ".parquet"


def table_pattern(table: str, partition: str | None = None) -> str:
    """Pattern of the paths of all parts of a table, or of one partition of it.

    >>> table_pattern("actions"), table_pattern("scalars", "train"), table_pattern("records")
    ('model/actions.parquet', 'model/scalars-train-*.parquet', 'canonical/records-*.parquet')
    """
    return _stem(table, partition) + ("-*" if LAYER_TABLES[table].is_of_groups else "") + ".parquet"


def paths_by_table(there: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Those of the paths `there` that are files of tables of layers, by table in the order of their rows."""
    found: dict[str, list[tuple[int, int, str]]] = {}
    for path in there:
        if (file := table_file(path)) is not None:
            partition = LAYER_TABLES[file.table].partitions.index(file.partition) if file.partition else 0
            found.setdefault(file.table, []).append((partition, file.part or 0, path))
    return {table: tuple(path for *_, path in sorted(own)) for table, own in found.items()}


def table_paths(table: str, there: Iterable[str]) -> tuple[str, ...]:
    """Those of the paths `there` that are files of a layer's table, in the order of their rows.

    >>> table_paths("scalars", ["model/scalars-val-00000.parquet", "model/scalars-train-00001.parquet", "LICENCE.txt"])
    ('model/scalars-train-00001.parquet', 'model/scalars-val-00000.parquet')
    """
    return paths_by_table(there).get(table, ())


def part_of_shard(index: int) -> int:
    """Number of the part with the rows of the groups of raw shard `index`.

    >>> part_of_shard(63), part_of_shard(64)
    (0, 1)
    """
    return index // PART_SHARDS


def part_of(folder: str) -> int:
    """Number of the part with the rows of the groups of a shard, by its folder relative to the root of its dataset.

    Raises:
        ValueError: No shard is called so.
    """
    index = shard_index(folder.removeprefix(f"{RAW_DIR}/"))
    if index is None:
        raise ValueError(f"{folder!r} is no folder of a shard")
    return part_of_shard(index)
