"""The derived layers, as `schemas/v0.1/layers.json` declares them: their tables and documents, in order.

Every layer is derived from the ones before it. Source: paper III-F; spec/10-layers.md#layers.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from branchdrive.contract.columns import LAYER_TABLES, Table
from branchdrive.contract.resources import load_resource

__all__ = ["LAYERS", "Layer", "LayerDocument", "layer_of_table", "table_path"]


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
        return tuple(f"{self.name}/{name}" for name in (*names, *(t.file_name for t in self.tables.values())))

    @property
    def files(self) -> tuple[str, ...]:
        """Paths relative to the root of the documents and tables that the layer may have."""
        names = (*self.documents, *(table.file_name for table in self.tables.values()))
        return tuple(f"{self.name}/{name}" for name in names)

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


def table_path(table: str) -> str:
    """Path of a layer's table relative to the root.

    Raises:
        KeyError: No derived layer has such a table.
    """
    return f"{layer_of_table(table)}/{LAYER_TABLES[table].file_name}"
