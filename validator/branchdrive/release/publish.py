"""Publication of derived layers: files beside their place first, then renamed, then descriptor, then manifest.

A release that is interrupted while it is published is no valid dataset until the build runs again; its raw
layer is never touched. Source: spec/03-layout.md#manifest, spec/10-layers.md#release.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from branchdrive.card.card import ADDED, REQUIRED, release_card
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import parse_json
from branchdrive.contract.layer import LAYERS, Layer
from branchdrive.contract.layout import (
    CARD_FILE,
    DESCRIPTOR_FILE,
    LICENCE_FILE,
    STAGING_DIR,
    WRITER_LOCK,
    layer_of,
)
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import BranchDriveError, DatasetError, ToolError, UsageError
from branchdrive.formats.descriptor_file import read_descriptor, render_descriptor
from branchdrive.formats.durable import delete, make_dir, move, sync_dir, write_file
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import Manifest, read_manifest, write_manifest
from branchdrive.release.built_layers import StoredFile
from branchdrive.runtime.file_lock import FileLock

__all__ = [
    "RENDER_DIR", "benchmark_area", "has_card", "is_rendering", "lock_area", "make_private", "publish", "publish_layer",
    "published_identity", "staging",
]  # fmt: skip

_BUILD_DIR = "build"
"""Folder in the staging area of who derives layers from a dataset."""
RENDER_DIR = "render"
"""Folder in the staging area of who derives media from a dataset."""
_WAITING = {_BUILD_DIR: "a build or a benchmark", RENDER_DIR: "`branchdrive render`"}

_NEW = "new"
_BENCHMARK = "benchmark-"
"""How the folders begin that wait for the benchmark of a release."""
_PRIVATE = 0o700
_WITH_CARD = "quality/split.json"
"""A file that is published with the card."""


@contextmanager
def lock_area(target: Path) -> Iterator[Path]:
    """The staging area of `target`, which no other command writes to meanwhile; what waits in it for a benchmark stays.

    Raises:
        UsageError: Another command is running there, a collection or a rendering has stopped in the middle, or a link
            leads out.
    """
    _refuse_links(target)
    area = target / STAGING_DIR
    make_dir(area)
    with _sole_writer(target, area, _BUILD_DIR):
        try:
            yield area
        finally:
            delete(area / _BUILD_DIR / _NEW)
            with suppress(OSError):  # parts that a build goes on from
                (area / _BUILD_DIR).rmdir()
            _leave(area)


@contextmanager
def staging(target: Path, *, create: bool = True, folder: str = _BUILD_DIR) -> Iterator[Path]:
    """The working area of a build, or a rendering, in `target`, which no other command writes to meanwhile.

    It stays if the build is interrupted or the machine fails it, so that the next one goes on, and goes if the build
    is refused. Whatever else lies in the staging area belongs to another command and is not touched.

    Args:
        target: The folder to build in.
        create: Whether it may be missing.
        folder: Name of the working area.

    Raises:
        UsageError: Another command is running there or has stopped in the middle, a link leads out of the folder, or
            it is missing and may not be.
    """
    is_new = not target.exists()
    if not create and not target.is_dir():
        raise UsageError(f"{target} is not a folder; give the folder that holds {DESCRIPTOR_FILE}")
    target.mkdir(parents=True, exist_ok=True)
    _refuse_links(target)
    area = target / STAGING_DIR
    make_dir(area)
    with _sole_writer(target, area, folder):
        work = area / folder
        make_private(work)
        try:
            yield work
            delete(work)
            _drop_stale_benchmarks(Folder(target), area)
        except ToolError:
            raise
        except BranchDriveError:
            delete(work)
            raise
        finally:
            with suppress(OSError):  # parts that a build goes on from
                work.rmdir()
            _leave(area)
            if is_new and not any(target.iterdir()):
                target.rmdir()


@contextmanager
def _sole_writer(target: Path, area: Path, folder: str) -> Iterator[None]:
    lock = FileLock(area / WRITER_LOCK)
    try:
        is_taken = lock.acquire(blocking=False)
    except FileNotFoundError:  # the process that had the area clears it away at this moment
        is_taken = False
    if not is_taken:
        raise UsageError(f"{target}: a collection, a build or a benchmark is running there; wait until it has finished")
    try:
        others = sorted({entry.name for entry in area.iterdir()} - {WRITER_LOCK, folder})
        others = [name for name in others if not name.startswith(_BENCHMARK)]
        if waiting := next((name for name in others if name in _WAITING), None):
            raise UsageError(
                f"{target}: {_WAITING[waiting]} was interrupted and left its work in {STAGING_DIR}/{waiting}; "
                "run it again to finish it, or delete that folder"
            )
        if others:
            raise UsageError(
                f"{target}: an unfinished collection has {others[0]!r} in {STAGING_DIR}; finish the collection before "
                "a release is built"
            )
        yield
    finally:
        lock.release()


def is_rendering(target: Path) -> bool:
    """Whether a rendering was interrupted at `target`, or is going on."""
    return (target / STAGING_DIR / RENDER_DIR).exists()


def published_identity(target: Folder) -> str:
    """Identity of the release that `target` holds, as its manifest has it.

    Raises:
        DatasetError: There is no manifest that could be read.
    """
    return _published_manifest(target).identity


def benchmark_area(target: Folder) -> Path:
    """Where the benchmark of the release that `target` holds works until it is published.

    Raises:
        DatasetError: There is no manifest that could be read.
    """
    return target.root / STAGING_DIR / f"{_BENCHMARK}{published_identity(target)[:16]}"


def _published_manifest(target: Folder) -> Manifest:
    return read_manifest(target)[0]


def has_card(target: Folder) -> bool:
    """Whether the card's place is taken by a card: by a file that the manifest lists.

    One that it does not list is anybody's, unless a build was interrupted in the middle of its quality layer.
    """
    try:
        listed = _published_manifest(target).files
    except DatasetError:
        listed = {}
    is_interrupted = (target.root / _WITH_CARD).exists() and _WITH_CARD not in listed
    return (target.root / CARD_FILE).is_file() and (CARD_FILE in listed or is_interrupted)


def _drop_stale_benchmarks(target: Folder, area: Path) -> None:
    """Remove what waits for the benchmark of another release than `target` now holds."""
    current = benchmark_area(target)
    for entry in area.iterdir():
        if entry.name.startswith(_BENCHMARK) and entry != current:
            delete(entry)


def make_private(folder: Path) -> None:
    """Make `folder` one that no other user could have filled: what is there of another's, or open to others, goes."""
    if folder.exists():
        status = folder.lstat()
        is_own = stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid()
        if not is_own or stat.S_IMODE(status.st_mode) != _PRIVATE:
            delete(folder)
    if not folder.exists():
        folder.mkdir(_PRIVATE)
        sync_dir(folder.parent)


def _leave(area: Path) -> None:
    """Remove the staging area if nothing but the lock is in it; call it under the lock."""
    if {entry.name for entry in area.iterdir()} == {WRITER_LOCK}:
        delete(area / WRITER_LOCK)
        with suppress(OSError):  # the next writer may be there already
            area.rmdir()


def _refuse_links(target: Path) -> None:
    """Links where a build writes would let it write elsewhere: the folder may come from a stranger."""
    area = target / STAGING_DIR
    layers = [target / layer for layer in LAYERS]
    inner = [entry for layer in layers for entry in layer.glob("*") if entry.is_dir() and not entry.is_symlink()]
    for folder in (target, area, *layers, *inner):
        for entry in sorted(folder.iterdir()) if folder.is_dir() else ():
            if entry.is_symlink():
                raise UsageError(f"{entry} is a link; a build writes into plain folders only, remove it")
    for entry in area.rglob("*"):
        if entry.is_symlink():
            raise UsageError(f"{entry} is a link; a build writes into plain folders only, remove it")


def publish(
    target: Folder, kept: Mapping[str, str], files: Mapping[str, bytes | StoredFile], descriptor: Descriptor
) -> Manifest:
    """Make `target` a dataset of `kept` and `files`, and nothing else.

    Args:
        target: The dataset.
        kept: SHA-256 of files that are there and stay, by path; `files` goes before it.
        files: All other files by path, descriptor and manifest excepted: their bytes, or where they wait, in the
            staging area or in their place.
        descriptor: What the dataset claims.

    Returns:
        Its manifest.

    Raises:
        DatasetError: A file that waits in its place was changed.
    """
    descriptor_bytes = render_descriptor(descriptor)
    digests = {path: _digest(file) for path, file in files.items()}
    digests[DESCRIPTOR_FILE] = hashlib.sha256(descriptor_bytes).hexdigest()
    root = target.root
    fresh = root / STAGING_DIR / _BUILD_DIR / _NEW
    delete(fresh)
    make_dir(fresh.parent)
    make_dir(fresh)
    waiting: dict[str, Path] = {}
    for path, file in files.items():
        if _is_there(root / path, digests[path]):
            continue
        if isinstance(file, bytes):
            waiting[path] = fresh / str(len(waiting))
            write_file(waiting[path], file)
        elif file.path == root / path:
            raise DatasetError(f"{target}: {path!r} was changed while the release was built; build again afterwards")
        else:
            waiting[path] = file.path
    for path, place in waiting.items():
        make_dir((root / path).parent)
        move(place, root / path)
    for path in _own_files(target):
        if path not in files and path not in kept:
            delete(root / path)
    for folder in [root / layer for layer in LAYERS]:
        for inner in (*(entry for entry in folder.glob("*") if entry.is_dir()), folder):
            if inner.is_dir() and not any(inner.iterdir()):
                inner.rmdir()
    target.replace(DESCRIPTOR_FILE, descriptor_bytes)
    manifest = Manifest.of({**kept, **digests})
    write_manifest(target, manifest)
    return manifest


def publish_layer(target: Folder, layer: str, files: Mapping[str, bytes]) -> Manifest:
    """Make `files` all that the last layer `layer` of the dataset `target` holds; everything else stays.

    The card of a release is rendered again, since it may tell of a document of the layer.

    Args:
        target: The dataset.
        layer: A layer after all others that the dataset claims, or the last of them.
        files: Bytes of its files by path; none drops the layer.

    Raises:
        DatasetError: The dataset has no descriptor or manifest that could be read.
    """
    descriptor = read_descriptor(target)
    claimed = [*(name for name in descriptor.layers if name != layer), *([layer] if files else [])]
    kept = {
        path: digest
        for path, digest in _published_manifest(target).files.items()
        if layer_of(path) != layer and path != DESCRIPTOR_FILE
    }
    claims = Descriptor.model_validate({**descriptor.model_dump(mode="json"), "layers": claimed})
    if CARD_FILE in kept:
        del kept[CARD_FILE]
        files = {**files, CARD_FILE: _card(target, claims, files, kept)}
    return publish(target, kept, files, claims)


def _card(target: Folder, descriptor: Descriptor, files: Mapping[str, bytes], kept: Collection[str]) -> bytes:
    """The card of a release of new `files` and `kept` ones."""
    contents = {path: files[path] for path in (*REQUIRED.values(), *ADDED.values()) if path in files}
    most = spec_limits().max_document_bytes
    contents |= {p: target.read(p, most) for p in (*REQUIRED.values(), *ADDED.values()) if p in kept}
    try:
        documents = {path: parse_json(content) for path, content in contents.items()}
        return release_card(descriptor, documents, {*files, *kept}).encode()
    except (ValueError, RecursionError, KeyError, TypeError) as error:
        raise DatasetError(f"{target}: the documents of the release give no card; run `branchdrive build`") from error


def _digest(file: bytes | StoredFile) -> str:
    return hashlib.sha256(file).hexdigest() if isinstance(file, bytes) else file.sha256


def _is_there(path: Path, digest: str) -> bool:
    if not path.is_file() or path.is_symlink():
        return False
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest() == digest


def _own_files(target: Folder) -> list[str]:
    """Files below `target` that a build has written, or may have."""
    card = [CARD_FILE] if has_card(target) else []
    root = target.root
    found = [entry.relative_to(root).as_posix() for layer in LAYERS for entry in sorted((root / layer).rglob("*"))]
    built = [path for path in found if _is_built(LAYERS[path.split("/")[0]], path)]
    return [path for path in (*card, LICENCE_FILE, *built) if (root / path).is_file()]


def _is_built(layer: Layer, path: str) -> bool:
    return layer.admits(path) or layer.admits_free(path) or path in layer.former_files
