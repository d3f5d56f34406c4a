"""Locking: what is fixed before outcomes of the test partition are looked at."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

from branchdrive.contract.document import dump_json
from branchdrive.derive.benchmark.lock import LockedCheckpoint, lock_document
from branchdrive.derive.benchmark.protocol import BenchmarkProtocol
from branchdrive.errors import UsageError
from branchdrive_reference.benchmark.lock import lock_facts
from branchdrive_reference.benchmark.release import Release
from branchdrive_reference.benchmark.training import model_tasks
from branchdrive_reference.benchmark.workspace import LOCK, Workspace
from branchdrive_reference.learning.checkpoint import Checkpoint, read_checkpoint
from branchdrive_reference.learning.configuration import MODEL_VERSION
from branchdrive_reference.learning.prediction import check_release

__all__ = ["make_lock"]

PACKAGE = "branchdrive-reference"


def make_lock(workspace: Workspace, protocol: BenchmarkProtocol) -> dict[str, Any]:
    """Lock the checkpoints of all declared models; the same lock where everything is as it was.

    Raises:
        UsageError: A checkpoint is missing, or was trained on another configuration, release or version.
        DatasetError: A checkpoint cannot be read.
    """
    release, locked = workspace.release, []
    for task in model_tasks(protocol):
        path = task.path(workspace.checkpoints)
        if not path.is_file():
            raise UsageError(f"{release.root}: {task.name} has no checkpoint; run `branchdrive train` first")
        checkpoint = read_checkpoint(path)
        _check(checkpoint, task.configuration.digest, release)
        origin = checkpoint.provenance
        locked.append(
            LockedCheckpoint(
                origin.model, origin.seed, f"checkpoints/{path.name}", checkpoint.sha256, origin.training_groups_digest
            )
        )
    code = f"{version('branchdrive')}+models.{MODEL_VERSION}"
    document = lock_document(protocol, lock_facts(release, protocol), locked, package=PACKAGE, version=code)
    if workspace.read(LOCK) != dump_json(document):
        workspace.keep(LOCK, dump_json(document))
    return document


def _check(checkpoint: Checkpoint, config_digest: str, release: Release) -> None:
    check_release(checkpoint, release.layer)
    if checkpoint.provenance.config_digest != config_digest:
        raise UsageError(
            f"{release.root}: {checkpoint!r} was trained under another configuration than the protocol declares; "
            "run `branchdrive train` again"
        )
