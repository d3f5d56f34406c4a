"""Finished shards of a collection into a bucket while it goes on, and all of it in the end.

The prefix is claimed for the writer of one folder. Media that are made of finished shards go there under the same
claim, from where they wait until all are made. When the dataset is finished, the claim is replaced by that for its
manifest, if nobody has changed it, and the upload ends as that of any dataset: what is not there yet, and the manifest
last and once. A killed run goes on in the same folder, as long as that has all that was sent.

Source: spec/03-layout.md#archives.
"""

from __future__ import annotations

import hashlib
import json
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import UsageError
from branchdrive.formats.bucket import Bucket
from branchdrive.formats.descriptor_file import read_descriptor, render_descriptor
from branchdrive.formats.folder import Folder
from branchdrive.formats.upload import CLAIM_FILE, UploadReport, claim_for, claim_prefix, send_file, upload_dataset
from branchdrive.raw.shard import find_shards

__all__ = ["ShardUpload"]


@dataclass
class ShardUpload:
    """The upload of one collection.

    Attributes:
        dataset: The folder where it is collected.
        target: The prefix, as it was listed at first.
        has_media: Whether the dataset is finished when it has media, and not before.
    """

    dataset: Folder
    target: Bucket
    has_media: bool = False
    _sent: set[str] = field(default_factory=set)
    _whole: set[str] = field(default_factory=set)
    _is_claimed: bool = False

    @classmethod
    def at(cls, dataset: Folder, url: str, media: Mapping[str, str] | None = None) -> ShardUpload:
        """The upload below the prefix at a URL, which is asked now: before hours of work, not after them.

        Args:
            dataset: The folder where it is collected.
            url: Of the prefix.
            media: Where media that are made already wait in the folder, by path in the dataset; ``None`` where none
                are made of finished shards.

        Raises:
            UsageError: It is no prefix that can be written, or holds what the folder does not: that was collected
                elsewhere, or here and is gone, and shards that are made again may have other bytes.
            PlatformError: The store cannot be reached or refuses.
        """
        target = Bucket.for_writing(url)
        if MANIFEST_FILE in target.versions and dataset.status(MANIFEST_FILE) is None:
            raise UsageError(f"{target} holds a finished dataset; name a prefix without objects")
        for path, version in sorted(target.versions.items()):
            found = dataset.status(path) or dataset.status((media or {}).get(path, path))
            if path not in (CLAIM_FILE, MANIFEST_FILE) and (found is None or found.size != version.size):
                raise UsageError(
                    f"{target} holds {path!r}, which {dataset} has not; name a prefix without objects, or the folder "
                    "where it was collected"
                )
        return cls(dataset, target, media is not None, {*target.versions})

    def send_shards(self, media: Mapping[str, str] | None = None) -> None:
        """Upload the shards that are finished by now; call it where no shard is written at this moment.

        Args:
            media: Files of media that are final, and wait in the folder: their places by path in the dataset.

        Raises:
            UsageError: The prefix is another writer's.
            PlatformError: The store refuses or fails; the same command goes on.
        """
        if self._is_finished():
            return  # `finish` is next, and what is finished is claimed by its manifest
        if not self._is_claimed:
            claim_prefix(self.target, self._claim())
            self._is_claimed = True
        for folder in (shard.prefix for shard in find_shards(self.dataset)):
            if folder not in self._whole:
                paths = [f"{folder}/{name}" for name in self.dataset.names(folder)]
                self._send(dict(zip(paths, paths, strict=True)))
                self._whole.add(folder)
        self._send(media or {})

    def _is_finished(self) -> bool:
        if self.dataset.status(MANIFEST_FILE) is None:
            return False
        return not self.has_media or bool(read_descriptor(self.dataset).cameras)

    def _send(self, files: Mapping[str, str]) -> None:
        """Upload what was not sent yet of files: their places by path in the dataset."""
        for path, place in files.items():
            if path not in self._sent:
                send_file(self.dataset, self.target, path, self.dataset.digest(place), place=place)
                self._sent.add(path)

    def finish(self, progress: Callable[[int, int], None] = lambda *_: None) -> UploadReport:
        """Upload what is left of the finished dataset, its manifest last; errors as `upload_dataset`."""
        target = self.target.listed()
        manifest = claim_for(self.dataset.read(MANIFEST_FILE, spec_limits().max_manifest_bytes))
        before = target.versions.get(CLAIM_FILE)
        if before is not None and target.read(CLAIM_FILE, spec_limits().max_document_bytes) == self._claim():
            if not target.put_over(CLAIM_FILE, manifest, before):
                raise UsageError(f"{target}: another writer has claimed it in the meantime; name another prefix")
            target = target.listed()
        return upload_dataset(self.dataset, target, progress)

    def _claim(self) -> bytes:
        """The claim for the collection in this folder of this machine, the same before and after it has media."""
        descriptor = render_descriptor(read_descriptor(self.dataset).without_media)
        folder = hashlib.sha256(f"{socket.gethostname()}\n{self.dataset.root.resolve()}".encode()).hexdigest()
        claim = {"descriptor_sha256": hashlib.sha256(descriptor).hexdigest(), "folder_sha256": folder}
        return json.dumps(claim).encode() + b"\n"
