"""Publication of derived layers: files beside their place first, then renamed, then descriptor, then manifest.

A release that is interrupted while it is published is no valid dataset until the build runs again; its raw
layer is never touched. Source: spec/03-layout.md#manifest, spec/10-layers.md#release.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layer import LAYERS
from branchdrive.dataset.descriptor_file import render_descriptor
from branchdrive.dataset.durable import delete, make_dir, move, replace_file, write_file
from branchdrive.dataset.layout import CARD_FILE, DESCRIPTOR_FILE, LICENCE_FILE, STAGING_DIR
from branchdrive.dataset.lock import FileLock
from branchdrive.dataset.manifest import Manifest, write_manifest
from branchdrive.errors import BranchDriveError, UsageError

__all__ = ["publish", "staging"]

_LOCK = "build.lock"
_NEW = "new"


@contextmanager
def staging(target: Path) -> Iterator[Path]:
    """The working area of a build in `target`, held by this process alone.

    It stays if the build is interrupted, so that the next one goes on, and goes if the build is refused.

    Raises:
        UsageError: Another build is at work there, or a link leads out of it.
    """
    is_new = not target.exists()
    target.mkdir(parents=True, exist_ok=True)
    _refuse_links(target)
    area = target / STAGING_DIR
    make_dir(area)
    lock = FileLock(area / _LOCK)
    if not lock.acquire(blocking=False):
        raise UsageError(f"{target}: another build is at work there; wait until it has finished")
    try:
        yield area
        delete(area)
    except BranchDriveError:
        delete(area)
        if is_new and not any(target.iterdir()):
            target.rmdir()
        raise
    finally:
        lock.release()


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
    fresh = target / STAGING_DIR / _NEW
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
