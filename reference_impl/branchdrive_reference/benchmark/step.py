"""The steps of a benchmark that need its models: train, lock, predict. Each goes on where it was interrupted.

The lock fixes all that could be chosen before outcomes of the test partition are looked at.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from importlib.metadata import version
from typing import Any, NamedTuple

from branchdrive.benchmark.lock import LockedCheckpoint, lock_digest, lock_document
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
from branchdrive.cli.progress import Update
from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import LOCK_FILE, RANKING_LOCK_FILE
from branchdrive.driving.feature import InputContract
from branchdrive.errors import UsageError
from branchdrive.formats.durable import delete
from branchdrive.runtime.executor import Executor
from branchdrive_reference.benchmark.document import waiting_risks
from branchdrive_reference.benchmark.guard.fold import fit_guard, fold_tasks
from branchdrive_reference.benchmark.lock import changed_checkpoints_of, lock_facts
from branchdrive_reference.benchmark.prediction import predict_all
from branchdrive_reference.benchmark.release import Release, benchmark_data, need_objects
from branchdrive_reference.benchmark.training import drop_stale, model_tasks, train
from branchdrive_reference.benchmark.workspace import Workspace
from branchdrive_reference.learning.checkpoint import Checkpoint, read_checkpoint
from branchdrive_reference.learning.configuration import MODEL_VERSION
from branchdrive_reference.learning.pool import Task
from branchdrive_reference.learning.prediction import check_release
from branchdrive_reference.learning.provenance import provenance
from branchdrive_reference.learning.training import training_data
from branchdrive_reference.learning.trees import need_scikit_learn

__all__ = ["Progress", "Trained", "lock_step", "make_lock", "predict_step", "train_step"]

PACKAGE = "branchdrive-reference"

Progress = Callable[[str], AbstractContextManager[Update]]
"""Opens a bar with a title."""


class Trained(NamedTuple):
    """What training took.

    Attributes:
        num_models: Models and seeds.
        num_there: Those of them that were there already.
        num_anew: Those of them, and folds, that were there under another configuration or version.
        models_s: Seconds for them.
        num_folds: Trained folds of the guard; 0 where its risk was there or is not wanted.
        guard_s: Seconds for the folds and the fit.
    """

    num_models: int
    num_there: int
    num_anew: int
    models_s: float
    num_folds: int
    guard_s: float


def train_step(
    workspace: Workspace,
    protocol: BenchmarkProtocol,
    *,
    models: Sequence[str] | None,
    jobs: int,
    executor: Executor | None = None,
    device: str,
    with_guard: bool,
    progress: Progress,
) -> Trained:
    """Train models, and the folds from which the risk of the guard is learned; its time is counted apart.

    Raises:
        PlatformError: Trees are missing, and the extra for them is not installed.
        UsageError: As `train_models`, no model is called so, or the guard cannot be fitted.
        DatasetError: The release or a checkpoint cannot be read, or it has no objects and a model reads some.
    """
    release, begin = workspace.release, time.monotonic()
    tasks = model_tasks(protocol, models)
    is_wanted = with_guard and (models is None or set(protocol.guard.models) <= set(models))
    folds = fold_tasks(release, protocol) if is_wanted else []  # what refuses them is said before anything is trained
    workspace.restore()
    num_anew = drop_stale(workspace.checkpoints, tasks)
    missing = [task for task in tasks if not task.path(workspace.checkpoints).exists()]
    if any(task.configuration.model.trees for task in missing):
        need_scikit_learn()
    if any(task.configuration.model.contract == InputContract.OBJECTS.value for task in missing):
        need_objects(release)
    num_there = len(tasks) - len(missing)
    with progress("training") as show:
        train(release, workspace.checkpoints, tasks, jobs=jobs, executor=executor, device=device, show=show)
    models_s, begin = time.monotonic() - begin, time.monotonic()
    if folds and _has_risk(workspace, protocol):
        folds = []
    if folds:
        num_anew += drop_stale(workspace.folds, folds)
        with progress("training folds of the guard") as show:
            train(release, workspace.folds, folds, jobs=jobs, executor=executor, device=device, show=show)
        fit_guard(workspace, protocol, benchmark_data(release), device=device)
    delete(workspace.folds)
    return Trained(len(tasks), num_there, num_anew, models_s, len(folds), time.monotonic() - begin)


def _has_risk(workspace: Workspace, protocol: BenchmarkProtocol) -> bool:
    """Whether a risk waits, or the published one is of this protocol and of the checkpoints that are there."""
    if waiting_risks(workspace, protocol):
        return True
    lock, published = (workspace.release.document(path) for path in (LOCK_FILE, RANKING_LOCK_FILE))
    if lock is None or published is None or published["risk_fit"] is None:
        return False
    is_of_lock = published["prediction_lock_digest"] == lock_digest(lock)
    is_of_protocol = lock["protocol_digest"] == protocol.digest
    return is_of_lock and is_of_protocol and not changed_checkpoints_of(workspace, lock)


def lock_step(workspace: Workspace, protocol: BenchmarkProtocol) -> dict[str, Any]:
    """Lock the trained checkpoints; see `make_lock`."""
    workspace.restore()
    return make_lock(workspace, protocol)


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
            raise UsageError(f"{release}: {task.name} has no checkpoint; run `branchdrive train` first")
        checkpoint = read_checkpoint(path)
        _check_provenance(checkpoint, task, release)
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


def _check_provenance(checkpoint: Checkpoint, task: Task, release: Release) -> None:
    """Hold the whole provenance against that of the task on this release."""
    check_release(checkpoint, release.layer)
    data = training_data(release.layer, task.configuration)
    expected = provenance(release.layer, task.configuration, task.seed, data).record
    for name, found in checkpoint.provenance.record.items():
        if found != expected[name]:
            raise UsageError(
                f"{release}: {task.name} has a checkpoint with the `{name}` {found!r}, expected "
                f"{expected[name]!r}; delete it and run `branchdrive train` again"
            )


def predict_step(workspace: Workspace, protocol: BenchmarkProtocol, *, device: str, progress: Progress) -> Workspace:
    """Predict with the locked checkpoints and publish; see `predict_all`. Returns the workspace as it is then."""
    workspace.restore()
    with progress("predicting") as show:
        predict_all(workspace, protocol, device=device, show=show)
    return workspace.reopened()
