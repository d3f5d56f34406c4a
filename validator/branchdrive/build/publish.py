"""Publication of derived layers: files beside their place first, then renamed, then descriptor, then manifest.

A release that is interrupted while it is published is no valid dataset until the build runs again; its raw
layer is never touched. Source: spec/03-layout.md#manifest, spec/10-layers.md#release.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layer import LAYERS
from branchdrive.dataset.descriptor_file import render_descriptor
from branchdrive.dataset.durable import delete, make_dir, move, replace_file, sync_dir, write_file
from branchdrive.dataset.layout import CARD_FILE, DESCRIPTOR_FILE, LICENCE_FILE, STAGING_DIR
from branchdrive.dataset.lock import FileLock
from branchdrive.dataset.manifest import Manifest, write_manifest
from branchdrive.errors import BranchDriveError, UsageError

__all__ = ["publish", "staging"]

_LOCK = "writer.lock"
"""The lock of the one `DatasetWriter`: who writes files of a release is a writer, and there is one at a time."""

_WORK = "build"
_NEW = "new"
_PRIVATE = 0o700


@contextmanager
def staging(target: Path, *, create: bool = True) -> Iterator[Path]:
    """The working area of a build in `target`, which nobody else writes to meanwhile, collectors included.

    It stays if the build is interrupted, so that the next one goes on, and goes if the build is refused. Whatever
    else lies in the staging area belongs to a collection and is not touched.

    Args:
        target: The folder to build in.
        create: Whether it may be missing.

    Raises:
        UsageError: A collection or another build is at work there, a collection has stopped in the middle, a link
            leads out of the folder, or it is missing and may not be.
    """
    is_new = not target.exists()
    if not create and not target.is_dir():
        raise UsageError(f"{target} is not a folder; give the folder that holds {DESCRIPTOR_FILE}")
    target.mkdir(parents=True, exist_ok=True)
    _refuse_links(target)
    area = target / STAGING_DIR
    make_dir(area)
    with _sole_writer(target, area):
        work = _work_folder(area)
        try:
            yield work
            delete(work)
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
def _sole_writer(target: Path, area: Path) -> Iterator[None]:
    lock = FileLock(area / _LOCK)
    try:
        is_taken = lock.acquire(blocking=False)
    except FileNotFoundError:  # whoever had the area clears it away at this moment
        is_taken = False
    if not is_taken:
        raise UsageError(f"{target}: a collection or another build is at work there; wait until it has finished")
    try:
        others = sorted({entry.name for entry in area.iterdir()} - {_LOCK, _WORK})
        if others:
            raise UsageError(
                f"{target}: an unfinished collection has {others[0]!r} in {STAGING_DIR}; finish the collection before "
                "a release is built"
            )
        yield
    finally:
        lock.release()


def _work_folder(area: Path) -> Path:
    """The builder's own folder, with what an interrupted build left there; one that another user could fill goes."""
    work = area / _WORK
    if work.exists():
        status = work.lstat()
        is_own = stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid()
        if not is_own or stat.S_IMODE(status.st_mode) != _PRIVATE:
            delete(work)
    if not work.exists():
        work.mkdir(_PRIVATE)
        sync_dir(area)
    return work


def _leave(area: Path) -> None:
    """Remove the staging area if nothing but the lock is in it; call it under the lock."""
    if {entry.name for entry in area.iterdir()} == {_LOCK}:
        delete(area / _LOCK)
        with suppress(OSError):  # the next writer may be there already
            area.rmdir()


def _refuse_links(target: Path) -> None:
    """Links where a build writes would let it write elsewhere: the folder may come from a stranger."""
    area = target / STAGING_DIR
    for folder in (target, area, *(target / layer for layer in LAYERS)):
        for entry in sorted(folder.iterdir()) if folder.is_dir() else ():
            if entry.is_symlink():
                raise UsageError(f"{entry} is a link; a build writes into plain folders only, remove it")
    for entry in area.rglob("*"):
        if entry.is_symlink():
            raise UsageError(f"{entry} is a link; a build writes into plain folders only, remove it")


def publish(target: Path, kept: Mapping[str, str], files: Mapping[str, bytes], descriptor: Descriptor) -> Manifest:
    """Make `target` a dataset of `kept` and `files`, and nothing else.

    Args:
        target: The dataset folder.
        kept: SHA-256 of files that are there and stay, by path.
        files: Bytes of all other files by path, descriptor and manifest excepted.
        descriptor: What the dataset claims.

    Returns:
        Its manifest.
    """
    descriptor_bytes = render_descriptor(descriptor)
    digests = {path: hashlib.sha256(content).hexdigest() for path, content in files.items()}
    digests[DESCRIPTOR_FILE] = hashlib.sha256(descriptor_bytes).hexdigest()
    fresh = target / STAGING_DIR / _WORK / _NEW
    delete(fresh)
    make_dir(fresh)
    waiting = {path: content for path, content in files.items() if not _is_there(target / path, digests[path])}
    for number, content in enumerate(waiting.values()):
        write_file(fresh / str(number), content)
    for number, path in enumerate(waiting):
        make_dir((target / path).parent)
        move(fresh / str(number), target / path)
    for path in _own_files(target):
        if path not in files:
            delete(target / path)
    for layer in LAYERS:
        folder = target / layer
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
    replace_file(target / DESCRIPTOR_FILE, descriptor_bytes)
    manifest = Manifest.of({**kept, **digests})
    write_manifest(target, manifest)
    return manifest


def _is_there(path: Path, digest: str) -> bool:
    if not path.is_file() or path.is_symlink():
        return False
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest() == digest


def _own_files(target: Path) -> list[str]:
    """Files below `target` that a build has written, or may have."""
    paths = [CARD_FILE, LICENCE_FILE, *(path for layer in LAYERS.values() for path in layer.files)]
    return [path for path in paths if (target / path).is_file()]
