"""Locking: what is fixed before outcomes of the test partition are looked at."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

from branchdrive.benchmark.lock import LockedCheckpoint, lock_document
from branchdrive.benchmark.protocol import BenchmarkProtocol
from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import LOCK_FILE
from branchdrive.errors import UsageError
from branchdrive_reference.benchmark.lock import lock_facts
from branchdrive_reference.benchmark.release import Release
from branchdrive_reference.benchmark.training import model_tasks
from branchdrive_reference.benchmark.workspace import Workspace
from branchdrive_reference.learning.checkpoint import Checkpoint, read_checkpoint
from branchdrive_reference.learning.configuration import MODEL_VERSION
from branchdrive_reference.learning.pool import Task
from branchdrive_reference.learning.prediction import check_release
from branchdrive_reference.learning.provenance import provenance
from branchdrive_reference.learning.training import training_data

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
        _check(checkpoint, task, release)
        origin = checkpoint.provenance
        locked.append(
            LockedCheckpoint(
                origin.model, origin.seed, f"checkpoints/{path.name}", checkpoint.sha256, origin.training_groups_digest
            )
        )
    code = f"{version('branchdrive')}+models.{MODEL_VERSION}"
    document = lock_document(protocol, lock_facts(release, protocol), locked, package=PACKAGE, version=code)
    if workspace.read(LOCK_FILE) != dump_json(document):
        workspace.keep(LOCK_FILE, dump_json(document))
    return document


def _check(checkpoint: Checkpoint, task: Task, release: Release) -> None:
    """Hold the whole provenance against that of the task on this release."""
    check_release(checkpoint, release.layer)
    data = training_data(release.layer, task.configuration)
    expected = provenance(release.layer, task.configuration, task.seed, data).record
    for name, found in checkpoint.provenance.record.items():
        if found != expected[name]:
            raise UsageError(
                f"{release.root}: {task.name} has a checkpoint with the `{name}` {found!r}, expected "
                f"{expected[name]!r}; delete it and run `branchdrive train` again"
            )
