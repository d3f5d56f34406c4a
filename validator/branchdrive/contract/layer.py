"""The derived layers, as `schemas/v0.1/layers.json` declares them: their tables and documents, in order.

Every layer is derived from the ones before it. Source: paper, "Release Structure"; spec/10-layers.md#layers.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from branchdrive.contract.columns import LAYER_TABLES, Table
from branchdrive.contract.resources import load_resource

__all__ = ["LAYERS", "TABLE_OF_PATH", "Layer", "LayerDocument", "layer_of_table", "table_path", "table_paths"]


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

    @property
    def required_files(self) -> tuple[str, ...]:
        """Paths relative to the root of the files that the layer must have."""
        names = [name for name, document in self.documents.items() if not document.optional]
        return tuple(f"{self.name}/{name}" for name in (*names, *self._table_files))

    @property
    def files(self) -> tuple[str, ...]:
        """Paths relative to the root of the documents and tables that the layer may have."""
        return tuple(f"{self.name}/{name}" for name in (*self.documents, *self._table_files))

    @property
    def _table_files(self) -> tuple[str, ...]:
        return tuple(name for table in self.tables.values() for name in table.file_names)

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


def table_path(table: str, partition: str | None = None) -> str:
    """Path of a layer's table relative to the root: of its only file, or of that with the rows of a partition.

    Raises:
        KeyError: No derived layer has such a table, or it has no such file.
    """
    declared = LAYER_TABLES[table]
    if not declared.partitions:
        return table_paths(table)[0]
    return dict(zip(declared.partitions, table_paths(table), strict=True))[str(partition)]


def table_paths(table: str) -> tuple[str, ...]:
    """Paths of all files of a layer's table relative to the root, in the order of their rows.

    >>> table_paths("actions"), table_paths("scalars")[0]
    (('model/actions.parquet',), 'model/scalars-train.parquet')

    Raises:
        KeyError: No derived layer has such a table.
    """
    return tuple(f"{layer_of_table(table)}/{name}" for name in LAYER_TABLES[table].file_names)


TABLE_OF_PATH: Mapping[str, str] = MappingProxyType({path: name for name in LAYER_TABLES for path in table_paths(name)})
"""Table of a derived layer that a file holds, or some rows of, by its path relative to the root."""
