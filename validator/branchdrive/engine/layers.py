"""Audit of the derived layers, from bytes to tallies: the function that a worker runs once a dataset.

Each file is read once; that buffer is hashed and decoded in full. Source: spec/07-rules.md#trust.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from branchdrive.benchmark.checkpoint import LENGTH_BYTES, header_bytes
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import parse_json, schema_mismatches
from branchdrive.contract.layer import LAYERS, table_path
from branchdrive.contract.layout import CARD_FILE, LICENCE_FILE
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.mismatch import Check, Location, Mismatch
from branchdrive.contract.rule import CATALOGUE, RULES, rules_of
from branchdrive.contract.text import printable
from branchdrive.engine import rules as _bind_rules  # noqa: F401  (importing binds the rules)
from branchdrive.engine.judge import judge
from branchdrive.engine.tally import Tally
from branchdrive.errors import DatasetError, DecodeError
from branchdrive.formats.parquet import decode_table
from branchdrive.formats.untrusted import open_file
from branchdrive.layers.compare import place
from branchdrive.layers.view import RawLayer, ReleaseView
from branchdrive.quality.rules import POPULATION
from branchdrive.tables.schema import CHECKED_METADATA, metadata_mismatches, type_mismatches

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["ReleaseResult", "ReleaseTask", "audit_release"]

CHECKPOINT_SUFFIX = ".safetensors"
"""Of files whose header is read; their tensors are digested alone."""

TEXT_SUFFIX = ".md"
"""Of files that are read as a whole."""

_CHUNK_BYTES = 1 << 20


_JUDGED_KEYS = tuple(key.encode() for key in CHECKED_METADATA)
_FORMAT_KEYS = (b"PARQUET:field_id",)
"""Metadata of a column that the file format adds."""

_POPULATION_RULE = "BD-QUA-011"
"""The rule that a population must pass before a report shows it."""


@dataclass(frozen=True)
class ReleaseTask:
    """What a worker needs to audit the derived layers.

    Attributes:
        root: The dataset folder.
        files: Files of the claimed layers, with card and licence beside them.
        names: Every regular file with a safe path below the root.
        descriptor: The dataset's descriptor.
        raw: The raw layer, as far as it is at hand.
        selected: Rules to run.
        is_hashed: Whether to digest the files.
    """

    root: Path
    files: tuple[str, ...]
    names: tuple[str, ...]
    descriptor: Descriptor
    raw: RawLayer
    selected: frozenset[str]
    is_hashed: bool


@dataclass
class ReleaseResult:
    """What became of the derived layers."""

    tallies: dict[str, Tally] = field(default_factory=dict)
    digests: dict[str, str] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)
    population: dict[str, Any] | None = None


@dataclass
class _Files:
    """Files as they are read: what decodes, what parses, and what is wrong by rule."""

    tables: dict[str, pa.Table] = field(default_factory=dict)
    documents: dict[str, Any] = field(default_factory=dict)
    contents: dict[str, bytes] = field(default_factory=dict)
    sizes: dict[str, int] = field(default_factory=dict)
    mismatches: dict[str, list[Mismatch]] = field(default_factory=dict)

    def note(self, rule_id: str, mismatch: Mismatch) -> None:
        self.mismatches.setdefault(rule_id, []).append(mismatch)


def audit_release(task: ReleaseTask) -> ReleaseResult:
    """Read and judge the derived layers that the descriptor claims."""
    result, files = ReleaseResult(), _Files()
    for name in task.descriptor.derived_layers:
        for table in LAYERS[name].tables:
            _read_table(task, f"{name}/{table}.parquet", table, files, result)
        for document in LAYERS[name].documents.values():
            _read_document(task, f"{name}/{document.name}", document.schema, files, result)
        for path in task.files:
            if LAYERS[name].admits_free(path):
                _read_free(task, path, files, result)
    for path in (CARD_FILE, LICENCE_FILE):
        if (content := _read(task, path, spec_limits().max_document_bytes, result)) is not None:
            files.contents[path] = content
    view = ReleaseView(
        task.descriptor,
        files.tables,
        files.documents,
        files.contents,
        task.raw,
        frozenset(task.names),
        files.mismatches,
        digests=result.digests,
        sizes=files.sizes,
    )
    # Rules on structure come first and always run: they say which tables the others can trust.
    always = {rule_id for rule_id, info in CATALOGUE.items() if info.kind == "structure"} | {_POPULATION_RULE}
    judged = judge_layers(view, [r for r in rules_of("layers") if r in task.selected or r in always])
    result.tallies = {rule_id: tally for rule_id, tally in judged.items() if rule_id in task.selected}
    if judged[_POPULATION_RULE].status == "pass":
        result.population = files.documents[POPULATION]
    return result


def _read(task: ReleaseTask, path: str, limit: int, result: ReleaseResult) -> bytes | None:
    if path not in task.files:
        return None
    try:
        with open_file(task.root, path) as stream:
            content = stream.read(min(os.fstat(stream.fileno()).st_size, limit) + 1)
    except (DatasetError, OSError) as error:
        result.unreadable[path] = str(error)
        return None
    if task.is_hashed and len(content) <= limit:
        result.digests[path] = hashlib.sha256(content).hexdigest()
    return content


def _read_free(task: ReleaseTask, path: str, files: _Files, result: ReleaseResult) -> None:
    """Digest a further file; of a checkpoint keep the header, of a text all."""
    limits = spec_limits()
    if path.endswith(TEXT_SUFFIX):
        if (content := _read(task, path, limits.max_document_bytes, result)) is not None:
            files.contents[path] = content
        return
    digest = hashlib.sha256()
    try:
        with open_file(task.root, path) as stream:
            size = os.fstat(stream.fileno()).st_size
            if size > limits.max_media_bytes:
                result.unreadable[path] = f"has {size} bytes; the limit is {limits.max_media_bytes}"
                return
            head = stream.read(LENGTH_BYTES)
            if path.endswith(CHECKPOINT_SUFFIX):
                with suppress(ValueError):  # what is no checkpoint is the matter of a rule
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


def _read_table(task: ReleaseTask, path: str, name: str, files: _Files, result: ReleaseResult) -> None:
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
        files.tables[name] = table
        for found in (*metadata_mismatches(table.schema, name), *_undeclared_metadata(table.schema, name)):
            files.note("BD-LYR-004", found.within({"file": path}))


def _undeclared_metadata(schema: pa.Schema, name: str) -> Iterator[Mismatch]:
    """What a table of a derived layer stores beside its rows and the declared metadata of its columns."""
    for key in schema.metadata or {}:
        yield Mismatch({"column": ""}, "no metadata of the file", printable(key.decode("utf-8", "replace")))
    for column in LAYER_TABLES[name].columns:
        declared = {key.encode(): value.encode() for key, value in column.metadata.items()}
        for key, value in (schema.field(column.name).metadata or {}).items():
            if key in (*_FORMAT_KEYS, *_JUDGED_KEYS) or declared.get(key) == value:
                continue
            yield Mismatch(
                {"column": column.name}, "declared metadata alone", printable(key.decode("utf-8", "replace"))
            )


def _read_document(task: ReleaseTask, path: str, schema: str, files: _Files, result: ReleaseResult) -> None:
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


@np.errstate(all="ignore")  # what overflows or is no number is found by the rules, not by warnings
def judge_layers(view: ReleaseView, rule_ids: Iterable[str]) -> dict[str, Tally]:
    """Tallies of rules in order; tables that fail a rule are kept from those that require it."""
    tallies, broken = {}, dict[str, set[str]]()
    for rule_id in rule_ids:
        info = CATALOGUE[rule_id]
        tally = tallies[rule_id] = Tally(rule_id, is_claimed=info.layer is None or view.claims(info.layer))
        if tally.is_claimed:
            trusted = view.without({name for other in info.requires for name in broken.get(other, ())})
            bad = judge(tally, partial(RULES[rule_id], trusted), partial(_mismatches, view))
            broken[rule_id] = {check.table for check in bad if check.table is not None}
    return tallies


def _mismatches(view: ReleaseView, check: Check) -> Iterator[Mismatch]:
    for row in check.bad.tolist():
        found = check.mismatch(row)
        if check.table is not None:
            found = found.within(_row_location(view, check.table, row))
        yield found


def _row_location(view: ReleaseView, name: str, row: int) -> Location:
    """Location of a row: by its key, or by its number where a part of the key is null."""
    if all(view.tables[name][part][row].is_valid for part in LAYER_TABLES[name].key):
        return place(name, view.rows(name), row)
    return {"file": table_path(name), "table": name, "row": row}
