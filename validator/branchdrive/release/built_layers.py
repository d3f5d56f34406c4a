"""Derived layers as they are built: documents here, tables in files, and what of both a folder already holds.

Rows of tables are never held together: a table is written part by part, here or by workers, into the working area of
a build, and waits there until it is published.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from branchdrive.contract.columns import LAYER_TABLES, table_schema
from branchdrive.contract.document import dump_json, parse_json, schema_mismatches
from branchdrive.contract.layer import LAYERS, table_file, table_path, table_paths
from branchdrive.contract.layout import BENCHMARK_LEDGER_FILE, LEDGER_FILE, MANIFEST_FILE
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import DatasetError
from branchdrive.formats.durable import write_file
from branchdrive.formats.file_error import machine_faults
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import read_manifest
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.store import Store
from branchdrive.formats.table_file import layer_table_paths, partitions_of, read_table
from branchdrive.quality.ledger import Ledger, order_mismatches
from branchdrive.tables.arrow import from_arrow, to_arrow
from branchdrive.tables.frame import Frame, Values, concat, sort_rows

__all__ = ["LEDGERS", "BuiltLayers", "StoredFile", "TableStore", "load_layers", "load_ledger"]

LEDGERS = (LEDGER_FILE, BENCHMARK_LEDGER_FILE)
"""Documents that stay whatever becomes of the layers around them: they cannot be computed again."""


@dataclass(frozen=True)
class StoredFile:
    """A file of a release, wherever its bytes wait.

    Attributes:
        folder: The dataset that has it, or the working area of a build.
        name: Its path there.
        sha256: Its digest.
    """

    folder: Folder
    name: str
    sha256: str

    @property
    def path(self) -> Path:
        """Where it is."""
        return self.folder.root / self.name

    def rows(self, table: str) -> dict[str, Values]:
        """Its rows, of a table of a layer.

        Raises:
            DatasetError: It cannot be read any more.
        """
        return from_arrow(read_table(self.folder, self.name, table), table)


@dataclass(frozen=True)
class TableStore:
    """Where parts of tables are written; workers have it too.

    Attributes:
        area: A folder that is there when the first is written.
        keys: Action keys in presentation order, by which tables are sorted.
    """

    area: Folder
    keys: tuple[str, ...]

    def put(self, name: str, frame: Frame, part: int) -> dict[str, StoredFile]:
        """Write the rows of one part of a table, sorted by key; its files by path, none where it has no row.

        Raises:
            ContractError: Its columns are not those declared.
            PlatformError: The disk is full, or cannot be written.
        """
        declared = LAYER_TABLES[name]
        orders = {"action_key": self.keys, "partition": declared.partitions}
        rows = to_arrow(name, sort_rows(frame, declared.order, orders))
        return {
            path: self._write(path, encode_table(own))
            for partition, own in partitions_of(name, rows)
            for path in [table_path(name, partition, part)]
            if own.num_rows
        }

    def put_whole(self, name: str, frame: Frame) -> dict[str, StoredFile]:
        """Write a table that lies in no parts; its one file by path."""
        path = table_path(name)
        return {
            path: self._write(
                path,
                encode_table(to_arrow(name, sort_rows(frame, LAYER_TABLES[name].order, {"action_key": self.keys}))),
            )
        }

    def completed(self, names: Collection[str], files: Mapping[str, StoredFile]) -> dict[str, StoredFile]:
        """All files of tables, given those with rows: a table or partition without any gets its first part.

        An optional table without any row gets no file at all.
        """
        there = {file[:2] for path in files if (file := table_file(path)) is not None}
        begun = {name for name, _ in there}
        lacking = (
            (name, table_path(name, partition))
            for name in names
            if name in begun or not LAYER_TABLES[name].optional
            for partition in LAYER_TABLES[name].partitions or (None,)
            if (name, partition) not in there
        )
        return {
            **files,
            **{path: self._write(path, encode_table(table_schema(n).empty_table())) for n, path in lacking},
        }

    def _write(self, path: str, content: bytes) -> StoredFile:
        name = path.replace("/", "-")
        with machine_faults(self.area.root / name):
            write_file(self.area.root / name, content)
        return StoredFile(self.area, name, hashlib.sha256(content).hexdigest())


@dataclass
class BuiltLayers:
    """Layers of one release.

    Attributes:
        files: Tables, and further files, by path.
        documents: Documents by path.
        contents: Bytes of the documents by path.
    """

    files: dict[str, StoredFile] = field(default_factory=dict)
    documents: dict[str, Any] = field(default_factory=dict)
    contents: dict[str, bytes] = field(default_factory=dict)

    @property
    def paths(self) -> frozenset[str]:
        """Paths of all files."""
        return frozenset((*self.files, *self.contents))

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of every file, by path."""
        return {path: file.sha256 for path, file in self.files.items()} | {p: self.digest(p) for p in self.contents}

    def digest(self, path: str) -> str:
        """SHA-256 of a file's bytes."""
        if path in self.files:
            return self.files[path].sha256
        return hashlib.sha256(self.contents[path]).hexdigest()

    def rows(self, name: str) -> dict[str, Values]:
        """All rows of a table.

        Raises:
            DatasetError: A file of it cannot be read any more.
        """
        return concat([self.files[path].rows(name) for path in table_paths(name, self.files)])

    def put_tables(self, names: Collection[str], files: Mapping[str, StoredFile]) -> None:
        """Put tables, all files of which are given, in the place of what they were."""
        for name in names:
            for path in table_paths(name, self.files):
                del self.files[path]
        self.files |= files

    def put_document(self, path: str, document: Any) -> None:
        """Add a document."""
        self.documents[path] = document
        self.contents[path] = dump_json(document)

    @property
    def names(self) -> tuple[str, ...]:
        """Layers that are whole, in order."""
        whole, paths = [], self.paths
        for name, layer in LAYERS.items():
            if layer.missing(paths):
                break
            whole.append(name)
        return tuple(whole)

    def changed_since(self, before: Mapping[str, str]) -> bool:
        """Whether a file of `before`, the ledger apart, is not what it was: what is derived from it is of another.

        Args:
            before: SHA-256 of files by path.
        """
        now = self.digests
        return any(now.get(path) != digest for path, digest in before.items() if path != LEDGER_FILE)

    def drop(self, path: str) -> None:
        """Forget a file."""
        self.files.pop(path, None)
        self.contents.pop(path, None)
        self.documents.pop(path, None)

    def drop_after(self, layer: str) -> None:
        """Forget every layer that is derived from `layer`, but not the ledgers."""
        order = list(LAYERS)
        for name in order[order.index(layer) + 1 :]:
            free = {path for path in self.files if LAYERS[name].admits_free(path)}
            for path in {*LAYERS[name].own(self.paths), *LAYERS[name].own(self.documents), *free} - {*LEDGERS}:
                self.drop(path)


def load_layers(dataset: Folder) -> BuiltLayers:
    """Layers that a dataset holds whole, sound and as its manifest has them, up to the first that it does not.

    Ledgers are kept whatever became of the files beside them.

    Args:
        dataset: The dataset.
    """
    found, listed = BuiltLayers(), _listed_digests(dataset)
    for layer in LAYERS.values():
        read = BuiltLayers()
        try:
            for name in layer.tables:
                for path in layer_table_paths(dataset, name):
                    read_table(dataset, path, name)
                    read.files[path] = StoredFile(dataset, path, dataset.digest(path))
            for document in layer.documents.values():
                path = f"{layer.name}/{document.name}"
                if not document.optional or (dataset.root / path).is_file():
                    _load_document(read, dataset, path, document.schema)
            for path in (path for path in listed if layer.admits_free(path)):
                read.files[path] = StoredFile(dataset, path, dataset.digest(path))
            _check_digests(read, dataset, listed)
        except DatasetError:
            for path in LEDGERS:
                with suppress(DatasetError):
                    _load_document(found, dataset, path, _schema_of(path))
            break
        found.files |= read.files
        found.documents |= read.documents
        found.contents |= read.contents
    return found


def _listed_digests(dataset: Folder) -> dict[str, str]:
    """SHA-256 of files by path, as the manifest has them; none without a manifest."""
    try:
        manifest, _ = read_manifest(dataset)
    except DatasetError:
        return {}
    return dict(manifest.files)


def _check_digests(read: BuiltLayers, dataset: Folder, listed: Mapping[str, str]) -> None:
    """A layer that was interrupted while it was published is a mixture of two, whose files decode all the same."""
    for path, digest in read.digests.items():
        if listed.get(path) != digest:
            raise DatasetError(f"{dataset}: {path!r} is not the file that {MANIFEST_FILE} lists; build the layer again")


def _schema_of(path: str) -> str:
    layer, name = path.split("/")
    return LAYERS[layer].documents[name].schema


def _load_document(found: BuiltLayers, dataset: Folder, path: str, schema: str) -> None:
    found.contents[path], found.documents[path] = _document(dataset, path, schema)


def load_ledger(dataset: Store, path: str) -> Ledger | None:
    """One of `LEDGERS` of a dataset; None if there is none.

    Raises:
        DatasetError: It cannot be read, or its entries are out of order.
    """
    if dataset.status(path) is None:
        return None
    ledger: Ledger = _document(dataset, path, _schema_of(path))[1]
    for found in order_mismatches(ledger):
        raise DatasetError(
            f"{dataset}: {path!r} at {found.location['pointer']}: expected {found.expected}, found {found.found}; "
            "restore the file"
        )
    return ledger


def _document(dataset: Store, path: str, schema: str) -> tuple[bytes, Any]:
    """Bytes and content of a document that conforms to its schema.

    Raises:
        DatasetError: It cannot be read, or breaks its schema.
    """
    content = dataset.read(path, spec_limits().max_document_bytes)
    try:
        document = parse_json(content)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{dataset}: {path!r} {error}; build the layer again") from error
    for wrong in schema_mismatches(document, schema):
        pointer = wrong.location["pointer"]
        raise DatasetError(f"{dataset}: {path!r} at {pointer}: expected {wrong.expected}; build the layer again")
    return content, document
