"""Files of the tables of a dataset: how many there are, their bytes, and the rows that their footers promise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from branchdrive.contract.columns import TABLES, Table, declared_table
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layer import LAYERS, paths_by_table
from branchdrive.contract.layout import RAW_DIR, shard_name
from branchdrive.errors import DatasetError, DecodeError
from branchdrive.formats.store import Entry, Store
from branchdrive.formats.untrusted_parquet import promised_rows
from branchdrive.raw.shard import find_shards

__all__ = ["MOST_SHARDS", "TableFiles", "files_of_tables", "media_files"]

MOST_SHARDS = 100
"""Shards whose files are looked at; of more, sizes and counts are those of the first ones."""

_MOST_FOOTERS = 200
"""Files of one table whose footers are read."""


@dataclass(frozen=True)
class TableFiles:
    """Files of one table.

    Attributes:
        table: What is declared of it.
        layer: The layer that it belongs to, ``raw`` for a table of shards.
        files: Sorted by path.
        num_rows: Rows that the footers promise; ``None`` where one of them cannot be read.
        is_all: Whether the footers of all files were read.
        fault: Why rows are not known; empty where they are.
    """

    table: Table
    layer: str
    files: tuple[Entry, ...]
    num_rows: int | None
    is_all: bool
    fault: str = ""

    @property
    def num_bytes(self) -> int:
        """Stored bytes of all files."""
        return sum(entry.size for entry in self.files)


def files_of_tables(dataset: Store, descriptor: Descriptor) -> Iterator[TableFiles]:
    """Files of every table that a dataset claims, raw tables first; one that lacks its files has none.

    An optional table that is not there is not among them.
    """
    if descriptor.has_raw:
        shards = [_folder(dataset, f"{RAW_DIR}/{shard_name(s.index)}") for s in find_shards(dataset)[:MOST_SHARDS]]
        for name in descriptor.tables:
            found = (folder.get(TABLES[name].file_name) for folder in shards)
            yield _with_rows(dataset, name, RAW_DIR, [entry for entry in found if entry is not None])
    for layer in descriptor.derived_layers:
        entries = {entry.path: entry for entry in _folder(dataset, layer).values()}
        paths = paths_by_table(entries)
        for name, table in LAYERS[layer].tables.items():
            if name in paths or not table.optional:
                yield _with_rows(dataset, name, layer, [entries[path] for path in paths.get(name, ())])


def media_files(dataset: Store, descriptor: Descriptor) -> list[Entry]:
    """Files in raw shards that are no tables: archives of images, or folders of them."""
    if not descriptor.has_raw:
        return []
    names = {TABLES[name].file_name for name in descriptor.tables}
    shards = (_folder(dataset, f"{RAW_DIR}/{shard_name(s.index)}") for s in find_shards(dataset)[:MOST_SHARDS])
    return [entry for folder in shards for name, entry in folder.items() if name not in names]


def _folder(dataset: Store, path: str) -> dict[str, Entry]:
    """What a folder holds, by name; nothing where it cannot be listed."""
    try:
        return {entry.path.rsplit("/", 1)[-1]: entry for entry in dataset.entries(path)[1]}
    except OSError:
        return {}


def _with_rows(dataset: Store, name: str, layer: str, files: list[Entry]) -> TableFiles:
    declared, fault, num_rows = declared_table(name), "" if files else "has no file", 0
    for entry in files[:_MOST_FOOTERS]:
        try:
            with dataset.open(entry.path) as stream:
                num_rows += promised_rows(stream)
        except (DatasetError, DecodeError) as error:
            fault = str(error) if isinstance(error, DatasetError) else f"{entry.path!r} {error}"
            break
    return TableFiles(declared, layer, tuple(files), None if fault else num_rows, len(files) <= _MOST_FOOTERS, fault)
