"""Training the models of a benchmark, with one progress for all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
from branchdrive.cli.progress import Update
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.durable import delete
from branchdrive.runtime.executor import Executor
from branchdrive_reference.benchmark.release import Release
from branchdrive_reference.learning.checkpoint import Checkpoint
from branchdrive_reference.learning.configuration import MODEL_VERSION, Configuration
from branchdrive_reference.learning.pool import Task, train_models
from branchdrive_reference.learning.tensor_file import read_tensors
from branchdrive_reference.learning.training import EpochReport
from branchdrive_reference.learning.training_state import state_path

__all__ = ["drop_stale", "model_tasks", "train"]


def model_tasks(protocol: BenchmarkProtocol, models: Sequence[str] | None = None) -> list[Task]:
    """Every declared model with each of its seeds; of the named models only, where some are named.

    Raises:
        UsageError: No model is called so.
        DatasetError: A model's configuration is not one that this software can train.
    """
    declared = [model.id for model in protocol.models]
    unknown = [name for name in models or () if name not in declared]
    if unknown:
        raise UsageError(f"no model {unknown[0]!r}; the protocol declares {', '.join(declared)}")
    return [
        Task(Configuration.of(model), seed)
        for model in protocol.models
        if models is None or model.id in models
        for seed in model.seeds
    ]


def drop_stale(folder: Path, tasks: Sequence[Task]) -> int:
    """Delete what the folder holds of tasks as they were under another configuration or version, or damaged.

    Returns:
        How many models are trained again because of that.
    """
    stale = set()
    for task in tasks:
        path = task.path(folder)
        for file in (path, state_path(path)):
            if file.exists() and not _is_current(file, task):
                delete(file)
                stale.add(path)
    return len(stale)


def _is_current(file: Path, task: Task) -> bool:
    try:
        origin = read_tensors(file).document["provenance"]
        return (origin["config_digest"], origin["code_version"]) == (task.configuration.digest, MODEL_VERSION)
    except (DatasetError, LookupError, TypeError):
        return False


def train(
    release: Release,
    folder: Path,
    tasks: Sequence[Task],
    *,
    jobs: int,
    executor: Executor | None,
    device: str,
    show: Update,
) -> list[Checkpoint]:
    """Train the tasks, or go on where a training was interrupted; see `train_models`."""
    return train_models(
        release.root, folder, tasks, jobs=jobs, executor=executor, device=device, on_epoch=_watch(tasks, show)
    )


def _watch(tasks: Sequence[Task], show: Update) -> Callable[[EpochReport], None]:
    """Shows epochs of all tasks; one that is over, or was before, counts with all its epochs."""
    most = [task.configuration.training.max_epochs if task.configuration.model.is_trained else 0 for task in tasks]
    total, done = (
        sum(most),
        dict.fromkeys(((t.configuration.model.name, t.seed, t.fold and t.fold.number) for t in tasks), 0),
    )

    def watch(report: EpochReport) -> None:
        done[report.model, report.seed, report.fold] = report.max_epochs if report.is_last else report.epoch
        fold = "" if report.fold is None else f" fold {report.fold + 1}"
        show(sum(done.values()), total, f"epochs, {report.model} seed {report.seed}{fold} loss {report.val_loss:.3f}")

    show(0, total, "epochs")
    return watch
