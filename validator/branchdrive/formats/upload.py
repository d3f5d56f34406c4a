"""A finished dataset into a bucket: files first, the manifest last, and only where nothing else is.

Who begins claims the prefix for one manifest, with an object in the working area, by a request that one of many wins.
Under a claim there are files of that manifest alone, each held against its digest while it is sent, so that an upload
that was cut off goes on with what is not there yet. The manifest appears when all files are there, again only once.

Source: spec/03-layout.md#archives.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass

from branchdrive.contract.layout import MANIFEST_FILE, STAGING_DIR
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.bucket import Bucket
from branchdrive.formats.manifest import Manifest, sound_manifest
from branchdrive.formats.store import Store

__all__ = ["CLAIM_FILE", "UploadReport", "claim_for", "claim_prefix", "send_file", "upload_dataset"]

CLAIM_FILE = f"{STAGING_DIR}/upload.json"
"""Which manifest is being uploaded."""

WHOLE_BYTES = 64 << 20
"""Files of up to this size are sent at once, larger ones in parts."""

_AT_ONCE = 4
_PIECE_BYTES = 1 << 20


@dataclass(frozen=True)
class UploadReport:
    """What was uploaded.

    Attributes:
        num_files: Files of the dataset, the manifest among them.
        num_sent: Those that were not there yet.
        identity: Identity of the dataset.
    """

    num_files: int
    num_sent: int
    identity: str


def upload_dataset(
    dataset: Store, target: Bucket, progress: Callable[[int, int], None] = lambda *_: None
) -> UploadReport:
    """Put a finished dataset below a prefix, or go on with it.

    Args:
        dataset: The dataset.
        target: The prefix, as it was listed a moment ago.
        progress: Called with the number of files that are there, and of all.

    Raises:
        UsageError: The prefix holds something else, or another dataset is being uploaded there.
        DatasetError: The dataset is not finished, or is not what its manifest says.
        PlatformError: The store refuses or fails; the same command goes on.
    """
    manifest = sound_manifest(dataset)
    content = dataset.read(MANIFEST_FILE, spec_limits().max_manifest_bytes)
    is_finished = MANIFEST_FILE in target.versions
    if is_finished and target.read(MANIFEST_FILE, spec_limits().max_manifest_bytes) != content:
        raise UsageError(f"{target} holds another dataset; name a prefix without objects")
    if not is_finished:
        claim_prefix(target, claim_for(content))
    waiting = _waiting(dataset, target, manifest)
    if is_finished and waiting:
        raise DatasetError(f"{target}: {waiting[0]!r} is not there although {MANIFEST_FILE} is; remove that one first")
    done = len(manifest.files) - len(waiting)
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        progress(done, len(manifest.files))
        sent = [pool.submit(send_file, dataset, target, path, manifest.files[path]) for path in waiting]
        try:
            for number, one in enumerate(as_completed(sent), start=done + 1):
                one.result()
                progress(number, len(manifest.files))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    if not is_finished and not target.put_new(MANIFEST_FILE, content):
        now = target.listed()
        if now.read(MANIFEST_FILE, spec_limits().max_manifest_bytes) != content:
            raise UsageError(f"{target}: another writer has finished another dataset there; name another prefix")
    target.remove(CLAIM_FILE)
    return UploadReport(len(manifest.files) + 1, len(waiting) + (not is_finished), manifest.identity)


def claim_for(manifest: bytes) -> bytes:
    """Content of the claim of a prefix for one manifest."""
    return json.dumps({"manifest_sha256": hashlib.sha256(manifest).hexdigest()}).encode() + b"\n"


def claim_prefix(target: Bucket, claim: bytes) -> None:
    """Let a prefix be for one dataset alone, as a claim says it; nothing happens where that claim is there.

    Raises:
        UsageError: The prefix holds something else, or is claimed for another dataset.
        PlatformError: The store refuses or fails.
    """
    others = sorted(path for path in target.versions if path != CLAIM_FILE)
    if others and CLAIM_FILE not in target.versions:
        raise UsageError(f"{target} holds other objects, such as {others[0]!r}; name a prefix without objects")
    if target.put_new(CLAIM_FILE, claim):
        return
    found = target.listed()
    if CLAIM_FILE not in found.versions:
        raise UsageError(f"{target}: another writer has just finished there; run the same command again to see what")
    if found.read(CLAIM_FILE, spec_limits().max_document_bytes) != claim:
        raise UsageError(
            f"{target}: another dataset is being uploaded there; name another prefix, or remove what is there if its "
            "upload was given up"
        )


def _waiting(dataset: Store, target: Bucket, manifest: Manifest) -> list[str]:
    """Files that are not in the bucket yet; other objects are not there, nor files of another size."""
    if strange := sorted({*target.versions} - {*manifest.files, MANIFEST_FILE, CLAIM_FILE}):
        raise UsageError(f"{target} holds other objects, such as {strange[0]!r}; name a prefix without objects")
    waiting = []
    for path in sorted(manifest.files):
        found, there = dataset.status(path), target.versions.get(path)
        if there is None:
            waiting.append(path)
        elif found is None or found.size != there.size:
            raise UsageError(f"{target}: {path!r} is another file there; name a prefix without objects")
    return waiting


def send_file(dataset: Store, target: Bucket, path: str, digest: str, *, place: str | None = None) -> None:
    """Upload one file, whose bytes are those of its digest, below a prefix that is claimed.

    Args:
        dataset: The dataset.
        target: The prefix.
        path: Path of the file in the dataset.
        digest: SHA-256 of its bytes.
        place: Path of where it waits in the dataset's folder, unless it is in its own place.

    Raises:
        DatasetError: They are not.
        PlatformError: The store refuses or fails.
    """
    place = place or path
    found = dataset.status(place)
    if found is not None and found.size > WHOLE_BYTES:
        pieces = _Pieces(dataset, place)
        if not target.put_parts(path, pieces, lambda: pieces.digest == digest):
            raise _changed(dataset, path)
        return
    content = dataset.read(place, WHOLE_BYTES)
    if hashlib.sha256(content).hexdigest() != digest:
        raise _changed(dataset, path)
    target.put_new(path, content)  # what is there in the meantime was sent under the same claim


class _Pieces:
    """Bytes of a file, digested on their way.

    Args:
        dataset: The dataset.
        path: The file.
    """

    def __init__(self, dataset: Store, path: str) -> None:
        self._dataset, self._path = dataset, path
        self._digest = hashlib.sha256()

    def __iter__(self) -> Iterator[bytes]:
        with self._dataset.open(self._path) as stream:
            while piece := stream.read(_PIECE_BYTES):
                self._digest.update(piece)
                yield piece

    @property
    def digest(self) -> str:
        """SHA-256 of what was read."""
        return self._digest.hexdigest()


def _changed(dataset: Store, path: str) -> DatasetError:
    return DatasetError(f"{dataset}: {path!r} is not the file that {MANIFEST_FILE} lists; restore it")
