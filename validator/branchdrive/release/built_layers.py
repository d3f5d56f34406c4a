"""Derived layers as they are built: frames, documents and bytes, and what of them a folder already holds."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.document import dump_json, parse_json, schema_mismatches
from branchdrive.contract.layer import LAYERS, table_paths
from branchdrive.contract.layout import BENCHMARK_LEDGER_FILE, LEDGER_FILE, MANIFEST_FILE
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import DatasetError
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import read_manifest
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.table_file import layer_table_paths, part_numbers, parts_of, read_layer_table
from branchdrive.quality.ledger import Ledger, order_mismatches
from branchdrive.tables.arrow import from_arrow, to_arrow
from branchdrive.tables.frame import Frame, Values, sort_rows

__all__ = ["LEDGERS", "BuiltLayers", "load_layers", "load_ledger"]

LEDGERS = (LEDGER_FILE, BENCHMARK_LEDGER_FILE)
"""Documents that stay whatever becomes of the layers around them: they cannot be computed again."""


_PART = "part"
"""Column, while rows are sorted, with the part of each."""


@dataclass
class BuiltLayers:
    """Layers of one release.

    Attributes:
        keys: Action keys in presentation order, by which tables are sorted.
        parts: Number of the part of each group.
        frames: Tables by name.
        documents: Documents by path.
        contents: Bytes of every file by path.
    """

    keys: tuple[str, ...]
    parts: Mapping[str, int] = field(default_factory=dict)
    frames: dict[str, dict[str, Values]] = field(default_factory=dict)
    documents: dict[str, Any] = field(default_factory=dict)
    contents: dict[str, bytes] = field(default_factory=dict)

    def put_table(self, name: str, frame: Frame) -> None:
        """Add a table; its rows are sorted by the file that they belong in, and by key.

        Raises:
            ContractError: Its columns are not those declared.
        """
        declared = LAYER_TABLES[name]
        orders = {"action_key": self.keys, "partition": declared.partitions}
        key = declared.order
        if declared.is_of_groups:
            frame = {**frame, _PART: part_numbers(frame["group_id"].tolist(), self.parts)}
            key = (*declared.order[: len(declared.order) - len(declared.key)], _PART, *declared.key)
        ordered = sort_rows(frame, key, orders)
        self.drop_table(name)
        self.frames[name] = {column: values for column, values in ordered.items() if column != _PART}
        for path, rows in parts_of(name, to_arrow(name, self.frames[name]), self.parts).items():
            self.contents[path] = encode_table(rows)

    def drop_table(self, name: str) -> None:
        """Forget a table."""
        self.frames.pop(name, None)
        for path in table_paths(name, self.contents):
            del self.contents[path]

    def put_document(self, path: str, document: Any) -> None:
        """Add a document."""
        self.documents[path] = document
        self.contents[path] = dump_json(document)

    def digest(self, path: str) -> str:
        """SHA-256 of a file's bytes."""
        return hashlib.sha256(self.contents[path]).hexdigest()

    @property
    def names(self) -> tuple[str, ...]:
        """Layers that are whole, in order."""
        whole = []
        for name, layer in LAYERS.items():
            if layer.missing(self.contents):
                break
            whole.append(name)
        return tuple(whole)

    def changed_since(self, before: Mapping[str, bytes]) -> bool:
        """Whether a file of `before`, the ledger apart, is not what it was: what is derived from it is of another."""
        return any(self.contents.get(path) != content for path, content in before.items() if path != LEDGER_FILE)

    def drop(self, path: str) -> None:
        """Forget a document."""
        self.contents.pop(path, None)
        self.documents.pop(path, None)

    def drop_after(self, layer: str) -> None:
        """Forget every layer that is derived from `layer`, but not the ledgers."""
        order = list(LAYERS)
        for name in order[order.index(layer) + 1 :]:
            free = {path for path in self.contents if LAYERS[name].admits_free(path)}
            for path in {*LAYERS[name].own(self.contents), *LAYERS[name].own(self.documents), *free} - {*LEDGERS}:
                self.drop(path)
            for table in LAYERS[name].tables:
                self.frames.pop(table, None)


def load_layers(dataset: Folder, keys: tuple[str, ...], parts: Mapping[str, int] | None = None) -> BuiltLayers:
    """Layers that a dataset holds whole, sound and as its manifest has them, up to the first that it does not.

    Ledgers are kept whatever became of the files beside them.

    Args:
        dataset: The dataset.
        keys: Action keys in presentation order.
        parts: Number of the part of each group, for tables that are put; all are in the first by default.
    """
    found, listed = BuiltLayers(keys, parts or {}), _listed_digests(dataset)
    for layer in LAYERS.values():
        read = BuiltLayers(keys, parts or {})
        try:
            for name in layer.tables:
                paths = layer_table_paths(dataset, name)
                if not paths:
                    continue
                for path in paths:
                    read.contents[path] = dataset.read(path, spec_limits().max_table_bytes)
                read.frames[name] = from_arrow(read_layer_table(dataset, name), name)
            for document in layer.documents.values():
                path = f"{layer.name}/{document.name}"
                if not document.optional or (dataset.root / path).is_file():
                    _load_document(read, dataset, path, document.schema)
            for path in (path for path in listed if layer.admits_free(path)):
                read.contents[path] = dataset.read(path, spec_limits().max_table_bytes)
            _check_digests(read, dataset, listed)
        except DatasetError:
            for path in LEDGERS:
                with suppress(DatasetError):
                    _load_document(found, dataset, path, _schema_of(path))
            break
        for mine, other in (
            (found.frames, read.frames),
            (found.documents, read.documents),
            (found.contents, read.contents),
        ):
            mine.update(other)  # type: ignore[arg-type]
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
    for path in read.contents:
        if listed.get(path) != read.digest(path):
            raise DatasetError(f"{dataset}: {path!r} is not the file that {MANIFEST_FILE} lists; build the layer again")


def _schema_of(path: str) -> str:
    layer, name = path.split("/")
    return LAYERS[layer].documents[name].schema


def _load_document(found: BuiltLayers, dataset: Folder, path: str, schema: str) -> None:
    found.contents[path], found.documents[path] = _document(dataset, path, schema)


def load_ledger(dataset: Folder, path: str) -> Ledger | None:
    """One of `LEDGERS` of a dataset; None if there is none.

    Raises:
        DatasetError: It cannot be read, or its entries are out of order.
    """
    if not (dataset.root / path).exists():
        return None
    ledger: Ledger = _document(dataset, path, _schema_of(path))[1]
    for found in order_mismatches(ledger):
        raise DatasetError(
            f"{dataset}: {path!r} at {found.location['pointer']}: expected {found.expected}, found {found.found}; "
            "restore the file"
        )
    return ledger


def _document(dataset: Folder, path: str, schema: str) -> tuple[bytes, Any]:
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
