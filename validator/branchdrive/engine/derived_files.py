"""Files of the derived layers, from bytes to tables and documents, and the rules on their form.

Each file is read once; that buffer is hashed and decoded in full. The parts of tables are read part by part, all
other files together. What decodes waits in a spool for the rules on what it says. Source: spec/07-rules.md#trust.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from branchdrive.benchmark.checkpoint import LENGTH_BYTES, header_bytes
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import parse_json, schema_mismatches
from branchdrive.contract.identity import document_digest
from branchdrive.contract.layer import LAYERS, paths_by_table, table_file
from branchdrive.contract.layout import CARD_FILE, LICENCE_FILE
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.mismatch import Mismatch
from branchdrive.contract.rule import CATALOGUE, rules_of
from branchdrive.contract.text import printable
from branchdrive.engine.derived_places import foreign_groups, records_elsewhere, strays
from branchdrive.engine.derived_rules import judge_layers
from branchdrive.engine.finding import Finding
from branchdrive.engine.spool import Spool, spooled_table
from branchdrive.engine.tally import Tally
from branchdrive.errors import DatasetError, DecodeError
from branchdrive.files.survey import Survey
from branchdrive.formats.store import Store, size_of
from branchdrive.formats.table_file import join_parts
from branchdrive.formats.untrusted_parquet import decode_table
from branchdrive.layers.view import RawLayer, ReleaseView
from branchdrive.tables.content import table_digest
from branchdrive.tables.schema import CHECKED_METADATA, COLUMNS_KEY, metadata_mismatches, type_mismatches

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = [
    "STRUCTURE_RULES", "LayerFiles", "LayerFilesTask", "killed", "layer_files_tasks", "needs_raw", "read_layers",
]  # fmt: skip

STRUCTURE_RULES = tuple(rule_id for rule_id in rules_of("layers") if CATALOGUE[rule_id].kind == "structure")
"""Rules on the form of derived layers; they say which tables the others can trust, so they always run."""

CHECKPOINT_SUFFIX = ".safetensors"
"""Of files whose header is read; their tensors are digested alone."""

TEXT_SUFFIX = ".md"
"""Of files that are read as a whole."""

_CHUNK_BYTES = 1 << 20
_NO_PART = -1
_PLACES = "BD-LYR-010"
"""The rule that rows are in the files that they belong in."""
_PRESENCE = "BD-LYR-001"
"""The rule that files are there."""


_JUDGED_KEYS = tuple(key.encode() for key in CHECKED_METADATA)
_FORMAT_KEYS = (b"PARQUET:field_id",)
"""Metadata of a column that the file format adds."""


@dataclass(frozen=True)
class LayerFilesTask:
    """What a worker needs to read files of the derived layers.

    Attributes:
        dataset: The dataset.
        files: Files to read, of the claimed layers or beside them.
        descriptor: The dataset's descriptor.
        is_hashed: Whether to digest the files.
        spool: Where tables and documents go.
        part: Number of the part that the files are of; ``None`` of those that are of no part.
        names: Of the files of no part: every file of the claimed layers, and those beside them.
    """

    dataset: Store
    files: tuple[str, ...]
    descriptor: Descriptor
    is_hashed: bool
    spool: Spool
    part: int | None = None
    names: tuple[str, ...] = ()


def layer_files_tasks(survey: Survey, spool: Spool | None) -> tuple[LayerFilesTask, ...]:
    """Tasks that read the derived layers: of the files of no part, and of each part, in their order.

    There are none without a spool, or where there are no layers that may be read.
    """
    if spool is None or survey.excess or survey.descriptor is None or not survey.descriptor.derived_layers:
        return ()
    files: dict[int, list[str]] = {}
    for path in survey.release_files:
        found = table_file(path)
        files.setdefault(_NO_PART if found is None or found.part is None else found.part, []).append(path)
    others = LayerFilesTask(
        survey.folder,
        tuple(files.pop(_NO_PART, ())),
        survey.descriptor,
        survey.is_hashed,
        spool,
        names=survey.release_files,
    )
    parts = [replace(others, files=tuple(own), part=part, names=()) for part, own in sorted(files.items())]
    return tuple(replace(task, dataset=task.dataset.only(task.files)) for task in (others, *parts))


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
        num_rows: Rows of each file of a table in the spool, by path.
        foreign: First row, and number of rows, of each group that has no record in its part, by path.
        documents: Documents in the spool that conform to their schema.
        contents: Documents, texts and heads of checkpoints whose bytes are in the spool.
        sizes: Bytes of the checkpoints, by path.
        content: Digest of what each table and document says, by path.
        unjudged: Why the layers could not be judged as a whole; ``None`` if they can.
        is_exceeded: Whether that is because reading them takes more than this machine was allowed.
    """

    tallies: dict[str, Tally] = field(default_factory=dict)
    broken: dict[str, frozenset[str]] = field(default_factory=dict)
    digests: dict[str, str] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)
    num_rows: dict[str, int] = field(default_factory=dict)
    foreign: dict[str, dict[str, tuple[int, int]]] = field(default_factory=dict)
    documents: tuple[str, ...] = ()
    contents: tuple[str, ...] = ()
    sizes: dict[str, int] = field(default_factory=dict)
    content: dict[str, str] = field(default_factory=dict)
    unjudged: str | None = None
    is_exceeded: bool = False

    def add(self, other: LayerFiles) -> None:
        """Merge what became of further files."""
        for rule_id, tally in other.tallies.items():
            if rule_id in self.tallies:
                self.tallies[rule_id].add(tally)
            else:
                self.tallies[rule_id] = tally
        for rule_id, tables in other.broken.items():
            self.broken[rule_id] = self.broken.get(rule_id, frozenset()) | tables
        self.digests |= other.digests
        self.unreadable |= other.unreadable
        self.num_rows |= other.num_rows
        self.foreign |= other.foreign
        self.sizes |= other.sizes
        self.content |= other.content
        self.documents += other.documents
        self.contents += other.contents
        self.unjudged = self.unjudged or other.unjudged
        self.is_exceeded |= other.is_exceeded

    def note(self, rule_id: str, mismatches: Iterable[Mismatch]) -> None:
        """Add what is wrong with files of tables, beside what was counted when they were read."""
        tally = self.tallies.setdefault(rule_id, Tally(rule_id))
        for found in mismatches:
            tally.num_findings += 1
            tally.keep([Finding.of(rule_id, found)])
            if (file := table_file(str(found.location["file"]))) is not None:
                self.broken[rule_id] = self.broken.get(rule_id, frozenset()) | {file.table}

    def note_places(self, mismatches: Iterable[Mismatch]) -> None:
        """Add files with rows that belong elsewhere; where records do, no other table is known to be in its place."""
        self.note(_PLACES, mismatches)
        if "records" in self.broken.get(_PLACES, ()):
            self.broken[_PLACES] = frozenset(name for name, table in LAYER_TABLES.items() if table.is_of_groups)


@dataclass
class _Files:
    """Files as they are read: what decodes, what parses, and what is wrong by rule."""

    parts: dict[str, pa.Table] = field(default_factory=dict)
    documents: dict[str, Any] = field(default_factory=dict)
    contents: dict[str, bytes] = field(default_factory=dict)
    sizes: dict[str, int] = field(default_factory=dict)
    mismatches: dict[str, list[Mismatch]] = field(default_factory=dict)

    def tables(self, files: Collection[str]) -> dict[str, pa.Table]:
        """Tables all of whose `files` decode with the declared columns, by name."""
        paths = paths_by_table(files)
        whole = {name: paths[name] for name in LAYER_TABLES if name in paths and self.parts.keys() >= {*paths[name]}}
        return {name: join_parts([self.parts[path] for path in own]) for name, own in whole.items()}

    def note(self, rule_id: str, found: Mismatch) -> None:
        self.mismatches.setdefault(rule_id, []).append(found)


def read_layers(task: LayerFilesTask) -> LayerFiles:
    """Read files of the derived layers that the descriptor claims, judge their form, and spool what can be read."""
    result, files, paths = LayerFiles(), _Files(), paths_by_table(task.files)
    for name in task.descriptor.derived_layers:
        for table in LAYERS[name].tables:
            for path in paths.get(table, ()):
                _read_table(task, path, table, files, result)
        for document in LAYERS[name].documents.values():
            _read_document(task, f"{name}/{document.name}", document.schema, files, result)
        for path in task.files:
            if LAYERS[name].admits_free(path):
                _read_free(task, path, files, result)
    for path in (CARD_FILE, LICENCE_FILE):
        if (content := _read(task, path, spec_limits().max_document_bytes, result)) is not None:
            files.contents[path] = content
    if task.part is not None:
        for found in records_elsewhere(task.part, files.parts):
            files.note(_PLACES, found)
        result.foreign = foreign_groups(files.parts)
    result.num_rows = {path: table.num_rows for path, table in files.parts.items()}
    for path, table in files.parts.items():
        task.spool.put_table(spooled_table(path), table)
        if task.is_hashed:
            result.content[path] = table_digest(_table_of(path), table)
    if task.is_hashed:
        result.content |= {path: document_digest(document) for path, document in files.documents.items()}
    view = ReleaseView(
        task.descriptor,
        files.tables(task.files),
        files.documents,
        files.contents,
        RawLayer(None, "the raw layer was not read yet"),
        frozenset(task.files),
        files.mismatches,
        digests=result.digests,
        num_rows=result.num_rows,
        part=task.part,
        sizes=files.sizes,
    )
    result.tallies, result.broken = judge_layers(view, [rule_id for rule_id in STRUCTURE_RULES if rule_id != _PRESENCE])
    result.broken[_PLACES] = frozenset(_table_of(str(m.location["file"])) for m in files.mismatches.get(_PLACES, ()))
    if task.names:
        whole = ReleaseView(task.descriptor, {}, {}, {}, view.raw, frozenset(task.names))
        result.tallies |= judge_layers(whole, [_PRESENCE])[0]
    if task.part is None:
        task.spool.put("documents", files.documents)
        task.spool.put("contents", files.contents)
    result.documents, result.contents, result.sizes = tuple(files.documents), tuple(files.contents), files.sizes
    return result


def _table_of(path: str) -> str:
    file = table_file(path)
    if file is None:
        raise KeyError(path)
    return file.table


def killed(task: LayerFilesTask, culprits: Sequence[str]) -> LayerFiles:
    """What it says of a task that two processes died of it, and of each of its files `culprits` alone, too."""
    result = LayerFiles(is_exceeded=not culprits)
    for path in culprits:
        rule_id = "BD-LYR-005" if table_file(path) is None else "BD-LYR-002"
        tally = result.tallies.setdefault(rule_id, Tally(rule_id))
        tally.examined += 1
        tally.total += 1
        found = "killed the process that decoded it, twice"
        result.note(rule_id, [Mismatch({"file": path}, "a file that decodes within the memory limit", found)])
    limit = spec_limits().max_worker_bytes / 2**30
    what = "of no part" if task.part is None else f"of part {task.part}"
    result.unjudged = (
        f"{culprits[0]} killed the process that decoded it"
        if culprits
        else f"reading the {len(task.files)} files {what} together took more than {limit:.1f} GiB of memory"
    )
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
        for found in strays(path, table):
            files.note(_PLACES, found)


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
