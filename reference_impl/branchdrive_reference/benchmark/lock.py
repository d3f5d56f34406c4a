"""The prediction lock as it is read: of this release and protocol, with the checkpoints that it names."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

from branchdrive.benchmark.lock import LockFacts, changed_checkpoints, lock_mismatches
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
from branchdrive.contract.identity import claimed_files, content_identity
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.layout import LOCK_FILE
from branchdrive.errors import UsageError
from branchdrive.layers.content import layers_content
from branchdrive_reference.benchmark.document import stored_document
from branchdrive_reference.benchmark.release import Release
from branchdrive_reference.benchmark.workspace import Workspace

__all__ = ["changed_checkpoints_of", "lock_facts", "read_lock"]


def lock_facts(release: Release, protocol: BenchmarkProtocol) -> LockFacts:
    """What a lock of this release says of it."""
    listed = {path for path in release.manifest.files if path.split("/")[0] in LAYERS}
    content = layers_content(
        release.layer.folder, listed & claimed_files(release.layer.descriptor.derived_layers, listed)
    )
    return LockFacts(
        protocol.digest,
        content_identity(content, content),
        release.layer.scalings().scalars.split_digest,
        release.manifest.files["model/normalisation.json"],
        release.manifest.files["model/features.json"],
        release.layer.candidate_order,
    )


def read_lock(workspace: Workspace, protocol: BenchmarkProtocol) -> dict[str, Any]:
    """The lock of this release and protocol.

    Raises:
        UsageError: There is none, or it is of another release or protocol.
    """
    document = stored_document(workspace, LOCK_FILE)
    if document is None:
        raise UsageError(f"{workspace.release}: nothing is locked; run `branchdrive lock` first")
    for wrong in lock_mismatches(document, lock_facts(workspace.release, protocol)):
        raise UsageError(
            f"{workspace.release}: the lock at {wrong.location['pointer']} is of {wrong.found}, expected "
            f"{wrong.expected}; run `branchdrive lock` and `branchdrive predict` again"
        )
    found: dict[str, Any] = document
    return found


def changed_checkpoints_of(workspace: Workspace, lock: Mapping[str, Any]) -> tuple[str, ...]:
    """Files of the lock whose checkpoint is missing in the working area, or another one there."""
    files = [path for path in workspace.checkpoints.glob("*") if path.is_file()]
    digests = {f"{path.parent.name}/{path.name}": hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    return changed_checkpoints(lock, digests)
