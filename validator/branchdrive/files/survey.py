"""The dataset as files and documents: what the parent process sees before and after the shards.

Nothing here trusts a name: folders are walked and files are opened relative to the root step by step, links are
followed only where the caller asks for it, documents are bounded, and what lies beside the dataset is not looked at.

Source: spec/03-layout.md, spec/09-security.md.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from pydantic import ValidationError

from branchdrive.contract.companion import IGNORE_FILE, Companions, ignored_names
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import parse_json, schema_mismatches
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.layout import (
    CARD_FILE,
    DESCRIPTOR_FILE,
    LICENCE_FILE,
    MANIFEST_FILE,
    RAW_DIR,
    shard_index,
    unsafe_reason,
)
from branchdrive.contract.limits import Limits, spec_limits
from branchdrive.contract.mismatch import Mismatch
from branchdrive.contract.refusal import mismatches_of
from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.errors import DatasetError, UsageError
from branchdrive.files.shard_facts import ShardFacts
from branchdrive.files.walk import walk
from branchdrive.formats.manifest import Manifest, malformed, parse_manifest
from branchdrive.formats.store import Entry, Identity, Store

__all__ = ["NOT_READ", "Survey", "take_survey"]

NOT_READ = "the files exceed the limits together, and were not read"
"""Why nothing is judged that lies in them."""


@dataclass(frozen=True)
class Survey:
    """Everything known about a dataset as files and documents.

    Attributes:
        folder: Where the dataset is.
        entries: Every name in it that is no companion, sorted by path; cut off where there are too many.
        excess: How the files together exceed the limits; then none but the documents in the root is opened.
        num_beside: Names that are companions of the dataset; what lies in them was not looked at.
        has_ignore_file: Whether there is an ignore file.
        ignore_error: What is wrong with it.
        manifest: What the manifest states; ``None`` if there is none.
        manifest_mismatches: What is wrong with the manifest's text.
        document: The descriptor's JSON; ``None`` if it does not parse.
        document_error: Why it does not parse.
        schema_mismatches: Where the descriptor breaks its schema.
        conflicts: Where it contradicts itself.
        descriptor: The typed descriptor, ``None`` unless it is sound.
        is_hashed: Whether digests are computed.
        digests: SHA-256 of every file that was read, by path.
        unreadable: Why files that digests need could not be read, by path.
        shards: Results of the shards, by folder.
    """

    folder: Store
    entries: tuple[Entry, ...] = ()
    excess: tuple[Mismatch, ...] = ()
    num_beside: int = 0
    has_ignore_file: bool = False
    ignore_error: str | None = None
    manifest: Manifest | None = None
    manifest_mismatches: tuple[Mismatch, ...] = ()
    document: Any = None
    document_error: str | None = None
    schema_mismatches: tuple[Mismatch, ...] = ()
    conflicts: tuple[Mismatch, ...] = ()
    descriptor: Descriptor | None = None
    is_hashed: bool = True
    digests: dict[str, str] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)
    shards: tuple[ShardFacts, ...] = ()

    @cached_property
    def files(self) -> tuple[Entry, ...]:
        """Regular files with safe paths: all that is ever opened."""
        return tuple(e for e in self.entries if e.kind == "file" and unsafe_reason(e.path) is None)

    @cached_property
    def shard_folders(self) -> dict[str, tuple[Entry, ...]]:
        """Files of each raw shard folder, in order of the folders; none where nothing is to be opened."""
        folders: dict[str, list[Entry]] = {}
        for entry in () if self.excess else self.entries:
            parts = entry.path.split("/")
            is_inside = len(parts) > 2 or (len(parts) == 2 and entry.kind == "folder")
            if is_inside and parts[0] == RAW_DIR and shard_index(parts[1]) is not None:
                files = folders.setdefault("/".join(parts[:2]), [])
                if entry.kind == "file" and unsafe_reason(entry.path) is None:
                    files.append(entry)
        return {folder: tuple(files) for folder, files in sorted(folders.items())}

    @cached_property
    def release_files(self) -> tuple[str, ...]:
        """Files of the derived layers that the descriptor claims, with card and licence beside them."""
        if self.excess or self.descriptor is None or not self.descriptor.derived_layers:
            return ()
        layers = [LAYERS[layer] for layer in self.descriptor.derived_layers]
        return tuple(
            entry.path
            for entry in self.files
            if entry.path in (CARD_FILE, LICENCE_FILE)
            or any(layer.admits(entry.path) or layer.admits_free(entry.path) for layer in layers)
        )

    def is_damaged(self, path: str) -> bool:
        """Whether the file was read and its digest is not the manifest's."""
        listed = self.manifest.files.get(path) if self.manifest else None
        return listed is not None and self.digests.get(path, listed) != listed

    def is_condemned(self, path: str) -> bool:
        """Whether other rules already say that the file is missing, unreadable, damaged, or no regular file."""
        is_missing = self.manifest is not None and path in self.manifest.files and path not in self.paths
        return is_missing or path in self.unreadable or path in self._irregular or self.is_damaged(path)

    @cached_property
    def _irregular(self) -> frozenset[str]:
        return frozenset(entry.path for entry in self.entries if entry.kind not in ("file", "folder"))

    @cached_property
    def paths(self) -> frozenset[str]:
        """Every path below the root."""
        return frozenset(entry.path for entry in self.entries)

    @property
    def has_raw(self) -> bool:
        """Whether the dataset holds shards, or should."""
        claims = self.descriptor is None or self.descriptor.has_raw
        return claims or bool(self.shard_folders)

    @property
    def is_read(self) -> bool:
        """Whether anything that has part in the identity was read."""
        return bool(self.shards) or bool(self.release_files)

    def with_shards(self, shards: tuple[ShardFacts, ...]) -> Survey:
        """This survey with the shards' results and digests merged in."""
        digests, unreadable = dict(self.digests), dict(self.unreadable)
        for shard in shards:
            digests.update(shard.digests)
            unreadable.update(shard.unreadable)
        return replace(self, shards=shards, digests=digests, unreadable=unreadable)

    def with_layers(
        self, shards: tuple[ShardFacts, ...], digests: Mapping[str, str], unreadable: Mapping[str, str]
    ) -> Survey:
        """This survey with the results of its shards, or of those it was built from, and digests of derived layers."""
        digests, unreadable = {**self.digests, **digests}, {**self.unreadable, **unreadable}
        return replace(self, shards=shards, digests=digests, unreadable=unreadable)


def _conflicts(document: Any) -> tuple[Descriptor | None, tuple[Mismatch, ...]]:
    try:
        return Descriptor.model_validate(document), ()
    except ValidationError as error:
        return None, mismatches_of(error)


def _read_descriptor(folder: Store, limits: Limits) -> Iterator[tuple[str, Any]]:
    """Fields of a `Survey` that describe the descriptor, as far as reading gets."""
    try:
        content = folder.read(DESCRIPTOR_FILE, limits.max_document_bytes)
        yield "digests", {DESCRIPTOR_FILE: hashlib.sha256(content).hexdigest()}
        document = parse_json(content, limits)
    except (DatasetError, OSError, ValueError, RecursionError) as error:
        yield "document_error", str(error)
        return
    yield "document", document
    if not isinstance(document, dict) or document.get("spec_version") != SPEC_VERSION:
        return
    mismatches = tuple(schema_mismatches(document, "descriptor.schema.json"))
    yield "schema_mismatches", mismatches
    if not mismatches:
        descriptor, conflicts = _conflicts(document)
        yield "descriptor", descriptor
        yield "conflicts", conflicts


def _read_manifest(folder: Store, limits: Limits) -> Iterator[tuple[str, Any]]:
    """Fields of a `Survey` that describe the manifest."""
    if folder.status(MANIFEST_FILE) is None:
        return
    try:
        content = folder.read(MANIFEST_FILE, limits.max_manifest_bytes)
    except (DatasetError, OSError) as error:
        yield "manifest_mismatches", (malformed(0, str(error)),)
        return
    manifest, mismatches = parse_manifest(content, limits)
    yield "manifest", manifest
    yield "manifest_mismatches", tuple(mismatches)


def _read_patterns(folder: Store, limits: Limits) -> tuple[tuple[str, ...], str | None]:
    """Patterns of the ignore file, and what is wrong with it."""
    try:
        return ignored_names(folder.read(IGNORE_FILE, limits.max_ignore_bytes)), None
    except (DatasetError, OSError, ValueError) as error:
        return (), str(error)


def take_survey(folder: Store, *, hash_files: bool = True) -> Survey:
    """Survey of the dataset in a folder, without its shards.

    Args:
        folder: The dataset.
        hash_files: Whether to compute digests.

    Raises:
        UsageError: There is no dataset in it.
    """
    limits = spec_limits()
    if not folder.is_there:
        raise UsageError(f"{str(folder)!r} is not a folder; give the folder that holds {DESCRIPTOR_FILE}")
    if not any(folder.status(name) for name in (DESCRIPTOR_FILE, MANIFEST_FILE, RAW_DIR)):
        raise UsageError(
            f"{str(folder)!r} holds no dataset: none of {DESCRIPTOR_FILE}, {MANIFEST_FILE}, {RAW_DIR}/ is there"
        )
    fields = {**dict(_read_manifest(folder, limits)), **dict(_read_descriptor(folder, limits))}
    has_ignore_file = folder.status(IGNORE_FILE) is not None
    patterns, ignore_error = _read_patterns(folder, limits) if has_ignore_file else ((), None)
    listed = fields["manifest"].files if "manifest" in fields else ()
    tree = walk(folder, Companions(listed, patterns), limits)
    survey = Survey(
        folder,
        tree.entries,
        tree.excess(limits) + _unlisted(folder),
        tree.num_beside,
        has_ignore_file=has_ignore_file,
        ignore_error=ignore_error,
        is_hashed=hash_files,
        **fields,
    )
    if not hash_files:
        return replace(survey, digests={})
    return survey if survey.excess else _hash_outside(survey)


def _unlisted(folder: Store) -> tuple[Mismatch, ...]:
    """Why not all names are known; then as little is read as of too many."""
    return (Mismatch({}, "names that a folder can hold", folder.unlisted),) if folder.unlisted else ()


def _hash_outside(survey: Survey) -> Survey:
    """Digest what lies outside the shards and was not read yet; a file of several names is read once."""
    digests, unreadable = dict(survey.digests), {}
    read_by_others = {entry.path for files in survey.shard_folders.values() for entry in files}
    read_by_others |= {MANIFEST_FILE, *digests, *survey.release_files}
    limit = spec_limits().max_media_bytes
    read: dict[Identity, str] = {}
    for entry in survey.files:
        if entry.path in read_by_others:
            continue
        if entry.size > limit:
            unreadable[entry.path] = f"has {entry.size} bytes; the limit is {limit}"
            continue
        try:
            if entry.identity not in read:
                read[entry.identity] = survey.folder.digest(entry.path)
            digests[entry.path] = read[entry.identity]
        except (DatasetError, OSError) as error:
            unreadable[entry.path] = str(error)
    return replace(survey, digests=digests, unreadable=unreadable)
