"""Raw datasets that several machines collected, made into one: every file of a shard keeps its bytes.

The merged dataset grows beside its place and appears there whole, by one rename. What a run that was killed leaves is
no dataset, and the next run starts over. Files of the parts are linked to or copied, and never changed or moved.

Source: spec/03-layout.md#merging.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.descriptor import Descriptor, Origin
from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE, RAW_DIR, STAGING_DIR, shard_index, shard_name
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.text import listed
from branchdrive.errors import DatasetError, UsageError
from branchdrive.files.identity_print import prints_of, repeated
from branchdrive.formats.descriptor_file import differing_values, read_descriptor, render_descriptor
from branchdrive.formats.durable import delete, durable_stream, move, partial_path, sync_dir, write_file
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import Manifest, read_manifest
from branchdrive.raw.rollout import MAP, ROLLOUTS
from branchdrive.raw.shard import Shard
from branchdrive.runtime.file_lock import FileLock
from branchdrive.runtime.progress import unwatched
from branchdrive.writer.place_note import PlaceNote

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["MAY_DIFFER", "MergeReport", "merge_datasets"]

MAY_DIFFER = ("title", "description", "url", "keywords")
"""Fields of the descriptor that present a dataset; the merged one has those of the first part."""

_PIECE_BYTES = 2**20


@dataclass(frozen=True)
class MergeReport:
    """What a merge made.

    Attributes:
        identity: Identity of the merged dataset.
        num_parts: Datasets that it was made of.
        num_shards: Its shards.
        num_groups: Its branch groups.
        num_rollouts: Its attempts.
        is_renumbered: Whether shards have other numbers than in the parts.
        num_copied: Files that were copied, because the file system could not link to them.
    """

    identity: str
    num_parts: int
    num_shards: int
    num_groups: int
    num_rollouts: int
    is_renumbered: bool
    num_copied: int


@dataclass(frozen=True)
class _Part:
    """A finished dataset that is merged.

    Attributes:
        shards: Digests of the files of each shard, by their paths in it.
        outside: Digests of the files in no shard, the descriptor excepted, by path.
    """

    dataset: Folder
    descriptor: Descriptor
    manifest: Manifest
    shards: Mapping[int, Mapping[str, str]]
    outside: Mapping[str, str]

    def __str__(self) -> str:
        return str(self.dataset)


@dataclass(frozen=True, eq=False)
class _Source:
    """Where a shard of the merged dataset comes from."""

    part: _Part
    shard: Shard
    number: int

    def __str__(self) -> str:
        return str(self.shard.folder)

    @property
    def files(self) -> Mapping[str, str]:
        """Digests of its files, by their paths in the shard."""
        return self.part.shards[self.shard.index]

    def identities(self, column: str) -> list[str]:
        """Distinct texts in a column of the rollouts table, or all of them where they are identities of its rows."""
        texts = self.shard.decode(ROLLOUTS).column(column)
        ids: list[str] = (texts if column == "rollout_id" else texts.unique()).to_pylist()
        return ids


def merge_datasets(
    roots: Sequence[str | Path], output: str | Path, *, progress: Callable[[int, int, str], None] = unwatched
) -> MergeReport:
    """Make one dataset of raw datasets with equal descriptors and different groups.

    Shards keep their numbers where no two have the same, as those of parts of one collection (``collect --part``);
    otherwise they are numbered from 0 in the order of the parts, and the descriptor says where each comes from.
    Digests are those of the parts' manifests: what is copied is compared with them, what is linked to is not read,
    rollouts and maps excepted.

    Args:
        roots: Finished datasets with a raw layer and no other.
        output: Folder of the merged dataset, which must not exist.
        progress: Called with the number of steps done, of all steps, and what is worked on.

    Raises:
        UsageError: The output cannot be made there, a part is no finished raw dataset, or parts contradict each other:
            descriptors differ in more than `MAY_DIFFER`, a group or an attempt occurs twice, a town has two maps.
        DatasetError: A file of a part is missing, damaged or not the one of its manifest.
    """
    target = Path(output)
    _check_output(target, [Path(root) for root in roots])
    parts = [_open_part(Path(root)) for root in roots]
    for part in parts[1:]:
        _check_alike(parts[0], part)
    sources = _numbered(parts)
    num_steps = 2 * len(sources)
    sizes = _check_shards(sources, lambda done, source: progress(done, num_steps, f"checking {source}"))
    files = dict(parts[0].outside)
    for source in sources:
        folder = f"{RAW_DIR}/{shard_name(source.number)}"
        files |= {f"{folder}/{name}": digest for name, digest in source.files.items()}
    is_renumbered = any(source.number != source.shard.index for source in sources)
    descriptor = _descriptor(parts[0], sources)
    files[DESCRIPTOR_FILE] = hashlib.sha256(descriptor).hexdigest()
    if len(files) > spec_limits().max_files:
        raise UsageError(
            f"the merged dataset would have {len(files):,} files beside its manifest, which lists at most "
            f"{spec_limits().max_files:,}; merge fewer, or collect more groups a shard"
        )
    manifest = Manifest.of(files)
    num_copied = 0
    with _draft_of(target) as draft:
        for path in parts[0].outside:
            num_copied += _place(parts[0], path, draft / path)
        for done, source in enumerate(sources, start=len(sources)):
            progress(done, num_steps, f"placing {source}")
            num_copied += _place_shard(source, draft)
        sync_dir(draft / RAW_DIR)
        write_file(draft / DESCRIPTOR_FILE, descriptor)
        write_file(draft / MANIFEST_FILE, manifest.render())
    progress(num_steps, num_steps, "")
    return MergeReport(manifest.identity, len(parts), len(sources), *sizes, is_renumbered, num_copied)


def _check_output(target: Path, roots: Sequence[Path]) -> None:
    if not roots:
        raise UsageError("there is nothing to merge; name the folders of finished datasets")
    if os.path.lexists(target):
        raise UsageError(f"{target}: is there already; name a folder that does not exist")
    if not target.parent.is_dir():
        raise UsageError(f"{target}: its parent is not a folder; make it first")
    seen: set[Path] = set()
    for root in map(Path.resolve, roots):
        if root in seen:
            raise UsageError(f"{root}: is named twice; name each part once")
        if target.resolve().is_relative_to(root):
            raise UsageError(f"{target}: lies inside {root}, which is merged; name a folder outside of it")
        seen.add(root)


def _open_part(root: Path) -> _Part:
    dataset = Folder(root)
    if dataset.status(MANIFEST_FILE) is None:
        raise UsageError(f"{root}: has no {MANIFEST_FILE}; name a dataset, whose collection has finished")
    if dataset.status(STAGING_DIR) is not None:
        raise UsageError(f"{root}: has work of a command that runs or was cut off in {STAGING_DIR}; finish that first")
    descriptor = read_descriptor(dataset)
    if descriptor.layers != ("raw",):
        raise UsageError(
            f"{root}: claims the layers {listed(list(descriptor.layers))}, and what is derived of a part does not hold "
            "of the whole; merge raw datasets alone, then build a release of the result"
        )
    manifest, mismatches = read_manifest(dataset)
    if mismatches or manifest != Manifest.of(manifest.files):
        why = mismatches[0].found if mismatches else "derived digests do not follow from its files"
        raise DatasetError(f"{root}: {MANIFEST_FILE} is malformed: {why}; run `branchdrive-validate`")
    _check_digest(dataset, manifest, DESCRIPTOR_FILE)
    shards: dict[int, dict[str, str]] = {}
    outside: dict[str, str] = {}
    for path, digest in manifest.files.items():
        folder, _, rest = path.partition("/")
        name, _, file = rest.partition("/")
        number = shard_index(name) if folder == RAW_DIR and file else None
        if number is not None:
            shards.setdefault(number, {})[file] = digest
        elif path != DESCRIPTOR_FILE:
            outside[path] = digest
    return _Part(dataset, descriptor, manifest, shards, outside)


def _check_digest(dataset: Folder, manifest: Manifest, path: str) -> None:
    _compare(dataset, path, manifest.files.get(path, "none"), dataset.digest(path))


def _compare(dataset: Folder, path: str, listed: str, found: str) -> None:
    if listed != found:
        raise DatasetError(
            f"{dataset}: {path!r} has the digest {found}, and {MANIFEST_FILE} lists {listed}; restore the file"
        )


def _check_alike(first: _Part, other: _Part) -> None:
    fields = differing_values(*(_compared(part.descriptor) for part in (other, first)))
    if fields:
        raise UsageError(
            f"{other}: has another descriptor than {first} ({'; '.join(fields)}); merged datasets are of one "
            f"collection, and only {listed(list(MAY_DIFFER))} may differ"
        )
    outside = first.outside.items() ^ other.outside.items()
    if outside:
        raise UsageError(f"{other}: {min(outside)[0]!r} is not that of {first}; let both have one, or neither")


def _compared(descriptor: Descriptor) -> dict[str, Any]:
    document = descriptor.model_dump(mode="json")
    document["collection"].pop("origins", None)
    return {name: value for name, value in document.items() if name not in MAY_DIFFER}


def _numbered(parts: Sequence[_Part]) -> list[_Source]:
    """The shards of the merged dataset, by number."""
    own = [number for part in parts for number in part.shards]
    is_kept, fresh = len(set(own)) == len(own), count()
    sources = [
        _Source(part, Shard(part.dataset, number), number if is_kept else next(fresh))
        for part in parts for number in part.shards
    ]  # fmt: skip
    return sorted(sources, key=lambda source: source.number)


def _check_shards(sources: Sequence[_Source], watch: Callable[[int, _Source], None]) -> tuple[int, int]:
    """Refuse shards that contradict each other; how many groups and attempts they have."""
    prints: dict[str, dict[_Source, NDArray[np.uint64]]] = {"group_id": {}, "rollout_id": {}}
    sizes: dict[int | None, _Source] = {}
    maps = _Maps()
    for number, source in enumerate(sources):
        watch(number, source)
        path = source.shard.path(ROLLOUTS)
        _check_digest(source.part.dataset, source.part.manifest, path)
        table = source.shard.decode(ROLLOUTS)
        note = PlaceNote.of(table, str(source))
        sizes.setdefault(note.groups_per_shard if note is not None else None, source)
        if len(sizes) > 1:
            (size, at), (other_size, there) = sizes.items()
            raise UsageError(
                f"{there}: was written with {_places(other_size)} a shard, {at} with {_places(size)}; a writer that "
                "goes on could not tell where groups belong: collect all parts with the same number"
            )
        prints["group_id"][source] = prints_of(table.column("group_id").unique().to_pylist())
        prints["rollout_id"][source] = prints_of(table.column("rollout_id").to_pylist())
        if MAP in source.part.descriptor.tables:
            maps.check(source)
    for column, what in (("group_id", "group"), ("rollout_id", "attempt")):
        twice = repeated(prints[column], partial(_Source.identities, column=column))
        if twice:
            identity = min(twice)
            one, other = twice[identity][:2]
            raise UsageError(
                f"{what} {identity!r} is in {one} and {other}, the first of {len(twice):,}; collect each {what} in one "
                "part alone"
            )
    counts = [sum(map(len, prints[column].values())) for column in ("group_id", "rollout_id")]
    return counts[0], counts[1]


def _places(groups_per_shard: int | None) -> str:
    return "no note of places" if groups_per_shard is None else f"{groups_per_shard} places"


class _Maps:
    """The maps of all towns; of equal files, one is read."""

    def __init__(self) -> None:
        self._towns: dict[str, tuple[pa.Table, _Source]] = {}
        self._read: set[str] = set()

    def check(self, source: _Source) -> None:
        """Refuse a map that differs from that of the same town in an earlier shard."""
        import pyarrow.compute as pc

        path = source.shard.path(MAP)
        digest = source.part.manifest.files.get(path, "none")
        if digest in self._read:
            return
        _check_digest(source.part.dataset, source.part.manifest, path)
        table = source.shard.table(MAP)
        for town in table.column("town").unique().to_pylist():
            own = table.filter(pc.field("town") == town).sort_by("element_id").combine_chunks()
            earlier, at = self._towns.setdefault(town, (own, source))
            if not own.equals(earlier):
                raise UsageError(f"{source}: has another map of town {town!r} than {at}; use one map in all parts")
        self._read.add(digest)


def _descriptor(first: _Part, sources: Sequence[_Source]) -> bytes:
    """The first part's descriptor, with where renumbered shards come from."""
    origins = _origins(sources)
    if origins == first.descriptor.collection.origins:
        return first.dataset.read(DESCRIPTOR_FILE, spec_limits().max_document_bytes)
    collection = first.descriptor.collection.model_copy(update={"origins": origins})
    return render_descriptor(first.descriptor.model_copy(update={"collection": collection}))


def _origins(sources: Sequence[_Source]) -> tuple[Origin, ...]:
    runs: list[tuple[str, int, list[int]]] = []
    for source in sources:
        identity, number = _origin_of(source)
        if identity is None:
            continue
        if runs and runs[-1][0] == identity and runs[-1][1] + len(runs[-1][2]) == source.number:
            runs[-1][2].append(number)
        else:
            runs.append((identity, source.number, [number]))
    return tuple(Origin(identity=identity, first_shard=first, shards=tuple(own)) for identity, first, own in runs)


def _origin_of(source: _Source) -> tuple[str | None, int]:
    """Identity of the dataset that a shard was collected into, and its number there; no identity where it has that."""
    for origin in source.part.descriptor.collection.origins:
        place = source.shard.index - origin.first_shard
        if 0 <= place < len(origin.shards):
            return origin.identity, origin.shards[place]
    is_moved = source.number != source.shard.index
    return (source.part.manifest.identity if is_moved else None), source.shard.index


@contextmanager
def _draft_of(target: Path) -> Iterator[Path]:
    """A folder beside `target` that takes its name in the end, and goes where that fails."""
    lock = FileLock(target.with_name(f".{target.name}.lock"))
    if not lock.acquire(blocking=False):
        raise UsageError(f"{target}: another command merges there; wait for it or stop it")
    draft = partial_path(target)
    try:
        delete(draft)
        draft.mkdir()
        yield draft
        sync_dir(draft)
        if os.path.lexists(target):
            raise UsageError(f"{target}: has appeared meanwhile; name a folder that does not exist")
        move(draft, target)
    finally:
        delete(draft)
        lock.remove()


def _place_shard(source: _Source, draft: Path) -> int:
    """Put the files of a shard into the draft; how many were copied."""
    folder = draft / RAW_DIR / shard_name(source.number)
    folder.mkdir(parents=True)
    own = f"{RAW_DIR}/{shard_name(source.shard.index)}"
    num_copied = sum(_place(source.part, f"{own}/{name}", folder / name) for name in source.files)
    sync_dir(folder)
    return num_copied


def _place(part: _Part, path: str, target: Path) -> bool:
    """Link to a file, or copy it where that is impossible; whether it was copied."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with part.dataset.open(path) as stream:  # a regular file, reached by no link
        try:
            os.link(part.dataset.root / path, target, follow_symlinks=False)
        except OSError:
            digest = hashlib.sha256()
            with durable_stream(target) as copy:
                while piece := stream.read(_PIECE_BYTES):
                    digest.update(piece)
                    copy.write(piece)
            _compare(part.dataset, path, part.manifest.files[path], digest.hexdigest())
            return True
    return False
