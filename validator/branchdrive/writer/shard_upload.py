"""Finished shards of a collection into a bucket while it goes on, and all of it in the end.

The prefix is claimed for the writer of one folder. When the dataset is finished, the claim is replaced by that for its
manifest, if nobody has changed it, and the upload ends as that of any dataset: what is not there yet, and the manifest
last and once. A killed run goes on in the same folder, as long as that has all that was sent.

Source: spec/03-layout.md#archives.
"""

from __future__ import annotations

import hashlib
import json
import socket
from collections.abc import Callable
from dataclasses import dataclass, field

from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import UsageError
from branchdrive.formats.bucket import Bucket
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
    """

    dataset: Folder
    target: Bucket
    _sent: set[str] = field(default_factory=set)
    _is_claimed: bool = False

    @classmethod
    def at(cls, dataset: Folder, url: str) -> ShardUpload:
        """The upload below the prefix at a URL, which is asked now: before hours of work, not after them.

        Raises:
            UsageError: It is no prefix that can be written, or holds what the folder does not: that was collected
                elsewhere, or here and is gone, and shards that are made again may have other bytes.
            PlatformError: The store cannot be reached or refuses.
        """
        target = Bucket.for_writing(url)
        if MANIFEST_FILE in target.versions and dataset.status(MANIFEST_FILE) is None:
            raise UsageError(f"{target} holds a finished dataset; name a prefix without objects")
        for path, version in sorted(target.versions.items()):
            found = dataset.status(path)
            if path not in (CLAIM_FILE, MANIFEST_FILE) and (found is None or found.size != version.size):
                raise UsageError(
                    f"{target} holds {path!r}, which {dataset} has not; name a prefix without objects, or the folder "
                    "where it was collected"
                )
        return cls(dataset, target, {*target.versions})

    def send_shards(self) -> None:
        """Upload the shards that are finished by now; call it where no shard is written at this moment.

        Raises:
            UsageError: The prefix is another writer's.
            PlatformError: The store refuses or fails; the same command goes on.
        """
        if self.dataset.status(MANIFEST_FILE) is not None:
            return  # `finish` is next, and what is finished is claimed by its manifest
        if not self._is_claimed:
            claim_prefix(self.target, self._claim())
            self._is_claimed = True
        for shard in find_shards(self.dataset):
            for path in (f"{shard.prefix}/{name}" for name in self.dataset.names(shard.prefix)):
                if path not in self._sent:
                    send_file(self.dataset, self.target, path, self.dataset.digest(path))
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
        """The claim for the collection in this folder of this machine."""
        descriptor = self.dataset.read(DESCRIPTOR_FILE, spec_limits().max_document_bytes)
        folder = hashlib.sha256(f"{socket.gethostname()}\n{self.dataset.root.resolve()}".encode()).hexdigest()
        claim = {"descriptor_sha256": hashlib.sha256(descriptor).hexdigest(), "folder_sha256": folder}
        return json.dumps(claim).encode() + b"\n"
