"""Training models side by side, one process for each model and seed, each with one thread.

Which process trains a model changes none of its bits. An interruption reaches this process alone: it asks the
workers to stop, and each stops after the epoch it is in, with its state written.

Source: this project's choice.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from branchdrive.errors import UsageError
from branchdrive.model.reader import ModelLayer, open_model
from branchdrive.runtime.elsewhere import unseen_error
from branchdrive.runtime.executor import Executor
from branchdrive.runtime.progress import unwatched
from branchdrive.runtime.workers import run_each
from branchdrive_reference.learning.checkpoint import Checkpoint, checkpoint_path, read_checkpoint
from branchdrive_reference.learning.configuration import Configuration
from branchdrive_reference.learning.held_out import Fold, open_fold
from branchdrive_reference.learning.training import EpochReport, train_model

__all__ = ["Task", "train_models"]


class Task(NamedTuple):
    """One model with one seed, without the groups that a fold holds out."""

    configuration: Configuration
    seed: int
    fold: Fold | None = None

    @property
    def name(self) -> str:
        """Model, seed and fold, as errors name them."""
        held_out = "" if self.fold is None else f", fold {self.fold.number}"
        return f"{self.configuration.model.name}, seed {self.seed}{held_out}"

    def folder(self, folder: Path) -> Path:
        """Folder of its checkpoint: every fold has its own."""
        return folder if self.fold is None else folder / f"fold-{self.fold.number}"

    def path(self, folder: Path) -> Path:
        """Where its checkpoint stands."""
        return checkpoint_path(self.folder(folder), self.configuration.model.name, self.seed)

    def train(
        self, release: ModelLayer, folder: str | Path, device: str, on_epoch: Callable[[EpochReport], None]
    ) -> Checkpoint:
        """Train in this process; see `train_models`."""
        number = None if self.fold is None else self.fold.number
        return train_model(
            release if self.fold is None else open_fold(release, self.fold),
            self.folder(Path(folder)),
            self.configuration,
            seed=self.seed,
            device=device,
            on_epoch=lambda report: on_epoch(report._replace(fold=number)),
        )


def train_models(
    release: str | Path,
    folder: str | Path,
    tasks: Sequence[Task],
    *,
    jobs: int = 1,
    executor: Executor | None = None,
    device: str = "cpu",
    on_epoch: Callable[[EpochReport], None] = unwatched,
) -> list[Checkpoint]:
    """Train all tasks; what is finished or begun in the folder is not done again.

    Args:
        release: Folder of a release with its model layer.
        folder: Where checkpoints are written.
        tasks: Models and seeds, none twice.
        jobs: Processes; 1 is this process.
        executor: What trains instead of these; release and folder are on all of its machines.
        device: ``cpu``, ``cuda`` or ``auto``.
        on_epoch: Called in this process after every epoch of every task.

    Returns:
        Checkpoints in the order of the tasks.

    Raises:
        UsageError: As `train_model`, or two tasks have one name.
        DatasetError: As `train_model`.
        ToolError: A worker process died.
        PlatformError: Another machine has trained what this one does not see.
        KeyboardInterrupt: The user interrupted; every training can go on.
    """
    training = _Training(Path(release), Path(folder), device)
    _ = training.layer  # what is no release is refused before a process starts
    paths = [task.path(Path(folder)) for task in tasks]
    if len(set(paths)) < len(tasks):
        raise UsageError(f"two of {len(tasks)} tasks have one model, seed and fold; give each model its own name")
    there = [path.exists() for path in paths]
    for task in itertools.compress(tasks, there):
        training(task, on_epoch)  # which trains nothing, and refuses what is of another training
    missing = [task for task, is_there in zip(tasks, there, strict=True) if not is_there]
    if jobs > 1 or executor is not None:
        missing = _longest_first(missing)
    for _ in run_each(training, missing, jobs=jobs, executor=executor, watch=on_epoch):
        pass
    for task in missing:
        if not task.path(Path(folder)).exists():
            raise unseen_error(f"{folder}: {task.name}")
    return [read_checkpoint(path) for path in paths]


@dataclass(frozen=True)
class _Training:
    """Trains a task's model in whichever process."""

    release: Path
    folder: Path
    device: str

    def __reduce__(self) -> tuple[object, ...]:
        return _Training, (self.release, self.folder, self.device)  # every process opens the release for itself

    @cached_property
    def layer(self) -> ModelLayer:
        return open_model(self.release)

    def __call__(self, task: Task, between: Callable[[EpochReport], None]) -> None:
        task.train(self.layer, self.folder, self.device, between)


def _longest_first(tasks: Sequence[Task]) -> list[Task]:
    """Tasks that read images before those of histories and others, so that no process ends with a long one alone."""

    def briefness(task: Task) -> tuple[int, bool]:
        model = task.configuration.model
        return -len(model.images), model.history is None

    return sorted(tasks, key=briefness)
