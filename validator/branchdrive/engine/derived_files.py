"""Files of the derived layers, from bytes to tables and documents, and the rules on their form.

Each file is read once; that buffer is hashed and decoded in full. What decodes waits in a spool for the rules on
what it says. Source: spec/07-rules.md#trust.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from branchdrive.benchmark.checkpoint import LENGTH_BYTES, header_bytes
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import parse_json, schema_mismatches
from branchdrive.contract.identity import document_digest
from branchdrive.contract.layer import LAYERS, TABLE_OF_PATH, table_paths
from branchdrive.contract.layout import CARD_FILE, LICENCE_FILE
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.mismatch import Location, Mismatch
from branchdrive.contract.rule import CATALOGUE, rules_of
from branchdrive.contract.text import counted, printable, quote
from branchdrive.engine.derived_rules import judge_layers
from branchdrive.engine.spool import Spool
from branchdrive.engine.tally import Tally
from branchdrive.errors import DatasetError, DecodeError
from branchdrive.files.survey import Survey
from branchdrive.formats.folder import Folder, size_of
from branchdrive.formats.table_file import join_parts
from branchdrive.formats.untrusted_parquet import decode_table
from branchdrive.layers.view import RawLayer, ReleaseView
from branchdrive.tables.content import table_digest
from branchdrive.tables.schema import CHECKED_METADATA, COLUMNS_KEY, metadata_mismatches, type_mismatches
from branchdrive.tables.view import TableView

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["STRUCTURE_RULES", "LayerFiles", "LayerFilesTask", "layer_files_task", "needs_raw", "read_layers"]

STRUCTURE_RULES = tuple(rule_id for rule_id in rules_of("layers") if CATALOGUE[rule_id].kind == "structure")
"""Rules on the form of derived layers; they say which tables the others can trust, so they always run."""

CHECKPOINT_SUFFIX = ".safetensors"
"""Of files whose header is read; their tensors are digested alone."""

TEXT_SUFFIX = ".md"
"""Of files that are read as a whole."""

_CHUNK_BYTES = 1 << 20


_JUDGED_KEYS = tuple(key.encode() for key in CHECKED_METADATA)
_FORMAT_KEYS = (b"PARQUET:field_id",)
"""Metadata of a column that the file format adds."""


@dataclass(frozen=True)
class LayerFilesTask:
    """What a worker needs to read the derived layers.

    Attributes:
        dataset: The dataset.
        files: Files of the claimed layers, with card and licence beside them.
        names: Every regular file with a safe path below the root.
        descriptor: The dataset's descriptor.
        is_hashed: Whether to digest the files.
        spool: Where tables and documents go.
    """

    dataset: Folder
    files: tuple[str, ...]
    names: tuple[str, ...]
    descriptor: Descriptor
    is_hashed: bool
    spool: Spool


def layer_files_task(survey: Survey, spool: Spool | None) -> LayerFilesTask | None:
    """The task that reads the derived layers; ``None`` without a spool, or where there are none that may be read."""
    if spool is None or survey.excess or survey.descriptor is None or not survey.descriptor.derived_layers:
        return None
    names = tuple(entry.path for entry in survey.files)
    return LayerFilesTask(survey.folder, survey.release_files, names, survey.descriptor, survey.is_hashed, spool)


def needs_raw(survey: Survey, selected: frozenset[str]) -> bool:
    """Whether selected rules on the derived layers take rows of the raw one."""
    claimed = survey.descriptor.derived_layers if survey.descriptor else ()
    wanted = [CATALOGUE[rule_id] for rule_id in rules_of("layers", "layer_rows") if rule_id in selected]
    return any(info.needs_raw and info.layer in claimed for info in wanted)


@dataclass
class LayerFiles:
    """What became of the files of the derived layers.

    Attributes:
        tallies: Totals of the rules on structure.
        broken: Tables that break each of them.
        digests: SHA-256 of every file that was read, by path.
        unreadable: Why files could not be read, by path.
        tables: Tables in the spool.
        documents: Documents in the spool that conform to their schema.
        contents: Documents, texts and heads of checkpoints whose bytes are in the spool.
        sizes: Bytes of the checkpoints, by path.
        content: Digest of what each table and document says, by path.
    """

    tallies: dict[str, Tally] = field(default_factory=dict)
    broken: dict[str, frozenset[str]] = field(default_factory=dict)
    digests: dict[str, str] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)
    tables: tuple[str, ...] = ()
    documents: tuple[str, ...] = ()
    contents: tuple[str, ...] = ()
    sizes: dict[str, int] = field(default_factory=dict)
    content: dict[str, str] = field(default_factory=dict)


@dataclass
class _Files:
    """Files as they are read: what decodes, what parses, and what is wrong by rule."""

    parts: dict[str, pa.Table] = field(default_factory=dict)
    documents: dict[str, Any] = field(default_factory=dict)
    contents: dict[str, bytes] = field(default_factory=dict)
    sizes: dict[str, int] = field(default_factory=dict)
    mismatches: dict[str, list[Mismatch]] = field(default_factory=dict)

    @property
    def tables(self) -> dict[str, pa.Table]:
        """Tables all of whose files decode with the declared columns, by name."""
        names = dict.fromkeys(map(TABLE_OF_PATH.__getitem__, self.parts))
        whole = [name for name in names if self.parts.keys() >= {*table_paths(name)}]
        return {name: join_parts([self.parts[path] for path in table_paths(name)]) for name in whole}

    def note(self, rule_id: str, found: Mismatch) -> None:
        self.mismatches.setdefault(rule_id, []).append(found)


def read_layers(task: LayerFilesTask) -> LayerFiles:
    """Read the derived layers that the descriptor claims, judge their form, and spool what can be read."""
    result, files = LayerFiles(), _Files()
    for name in task.descriptor.derived_layers:
        for table in LAYERS[name].tables:
            for path in table_paths(table):
                _read_table(task, path, table, files, result)
        for document in LAYERS[name].documents.values():
            _read_document(task, f"{name}/{document.name}", document.schema, files, result)
        for path in task.files:
            if LAYERS[name].admits_free(path):
                _read_free(task, path, files, result)
    for path in (CARD_FILE, LICENCE_FILE):
        if (content := _read(task, path, spec_limits().max_document_bytes, result)) is not None:
            files.contents[path] = content
    if task.is_hashed:
        result.content = {
            **{path: table_digest(TABLE_OF_PATH[path], table) for path, table in files.parts.items()},
            **{path: document_digest(document) for path, document in files.documents.items()},
        }
    tables = files.tables
    view = ReleaseView(
        task.descriptor,
        tables,
        files.documents,
        files.contents,
        RawLayer(None, "the raw layer was not read yet"),
        frozenset(task.names),
        files.mismatches,
        digests=result.digests,
        num_rows={path: table.num_rows for path, table in files.parts.items()},
        sizes=files.sizes,
    )
    result.tallies, result.broken = judge_layers(view, STRUCTURE_RULES)
    for name, table in tables.items():
        task.spool.put_table(f"{name}.table", table)
    task.spool.put("documents", files.documents)
    task.spool.put("contents", files.contents)
    result.tables, result.documents = tuple(tables), tuple(files.documents)
    result.contents, result.sizes = tuple(files.contents), files.sizes
    return result


def _read(task: LayerFilesTask, path: str, limit: int, result: LayerFiles) -> bytes | None:
    if path not in task.files:
        return None
    try:
        with task.dataset.open(path) as stream:
            content = stream.read(min(size_of(stream), limit) + 1)
    except (DatasetError, OSError) as error:
        result.unreadable[path] = str(error)
        return None
    if task.is_hashed and len(content) <= limit:
        result.digests[path] = hashlib.sha256(content).hexdigest()
    return content


def _read_free(task: LayerFilesTask, path: str, files: _Files, result: LayerFiles) -> None:
    """Digest a further file; of a checkpoint keep the header, of a text all."""
    limits = spec_limits()
    if path.endswith(TEXT_SUFFIX):
        if (content := _read(task, path, limits.max_document_bytes, result)) is not None:
            files.contents[path] = content
        return
    digest = hashlib.sha256()
    try:
        with task.dataset.open(path) as stream:
            size = size_of(stream)
            if size > limits.max_media_bytes:
                result.unreadable[path] = f"has {size} bytes; the limit is {limits.max_media_bytes}"
                return
            head = stream.read(LENGTH_BYTES)
            if path.endswith(CHECKPOINT_SUFFIX):
                with suppress(ValueError):  # a rule checks what is not a checkpoint
                    head += stream.read(header_bytes(head) - LENGTH_BYTES)
                files.contents[path], files.sizes[path] = head, size
            digest.update(head)
            while task.is_hashed and (chunk := stream.read(_CHUNK_BYTES)):
                digest.update(chunk)
    except (DatasetError, OSError) as error:
        result.unreadable[path] = str(error)
        return
    if task.is_hashed:
        result.digests[path] = digest.hexdigest()


def _read_table(task: LayerFilesTask, path: str, name: str, files: _Files, result: LayerFiles) -> None:
    content = _read(task, path, spec_limits().max_table_bytes, result)
    if content is None:
        return
    try:
        table = decode_table(content, name)
    except DecodeError as error:
        files.note("BD-LYR-002", Mismatch({"file": path}, "a table that decodes within the limits", str(error)))
        return
    wrong = list(type_mismatches(table.schema, name))
    for found in wrong:
        files.note("BD-LYR-003", found.within({"file": path}))
    if not wrong:
        files.parts[path] = table
        for found in (*metadata_mismatches(table.schema, name), *_undeclared_metadata(table.schema, name)):
            files.note("BD-LYR-004", found.within({"file": path}))
        for found in _strays(path, name, table):
            files.note("BD-LYR-010", found.within({"file": path}))


def _strays(path: str, name: str, table: pa.Table) -> Iterator[Mismatch]:
    """Rows of a file that are of another partition than the one that it is for: the first of them, and how many."""
    own = dict(zip(table_paths(name), LAYER_TABLES[name].partitions, strict=False)).get(path)
    if own is None:
        return
    codes, texts = TableView(name, table).categories("partition")
    is_other = np.array([text != own for text in texts] + [False], bool)  # a null is another rule's
    rows = np.flatnonzero(is_other[codes])
    if len(rows):
        where: Location = {"table": name, "column": "partition", "row": int(rows[0])}
        found = f"{counted(len(rows), 'row')} of others, the first of {quote(texts[codes[rows[0]]])}"
        yield Mismatch(where, f"rows of {own!r} alone", found)


def _undeclared_metadata(schema: pa.Schema, name: str) -> Iterator[Mismatch]:
    """What a table of a derived layer stores beside its rows and the declared metadata of its columns."""
    for key in (schema.metadata or {}).keys() - {COLUMNS_KEY.encode()}:
        yield Mismatch({}, "no metadata of the file", printable(key.decode("utf-8", "replace")))
    for column in LAYER_TABLES[name].columns:
        declared = {key.encode(): value.encode() for key, value in column.metadata.items()}
        for key, value in (schema.field(column.name).metadata or {}).items():
            if key in (*_FORMAT_KEYS, *_JUDGED_KEYS) or declared.get(key) == value:
                continue
            yield Mismatch(
                {"column": column.name}, "declared metadata alone", printable(key.decode("utf-8", "replace"))
            )


def _read_document(task: LayerFilesTask, path: str, schema: str, files: _Files, result: LayerFiles) -> None:
    content = _read(task, path, spec_limits().max_document_bytes, result)
    if content is None:
        return
    files.contents[path] = content
    try:
        document = parse_json(content)
    except (ValueError, RecursionError) as error:
        files.note("BD-LYR-005", Mismatch({"file": path}, "a JSON document within the limits", str(error)))
        return
    mismatches = schema_mismatches(document, schema)
    for found in mismatches:
        files.note("BD-LYR-005", found.within({"file": path}))
    if not mismatches:
        files.documents[path] = document
