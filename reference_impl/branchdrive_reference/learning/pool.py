"""Training models side by side, one process for each model and seed, each with one thread.

Which process trains a model changes none of its bits. An interruption reaches this process alone: it asks the
workers to stop, and each stops after the epoch it is in, with its state written.

Source: this project's choice.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from multiprocessing.queues import SimpleQueue
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import ClassVar, NamedTuple

from branchdrive.errors import UsageError
from branchdrive.interrupt import deferred_interrupt
from branchdrive.model.reader import ModelLayer, open_model
from branchdrive.process import spawn_context
from branchdrive.workers import WorkerError, started_workers
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
    device: str = "cpu",
    on_epoch: Callable[[EpochReport], None] | None = None,
) -> list[Checkpoint]:
    """Train all tasks; what is finished or begun in the folder is not done again.

    Args:
        release: Folder of a release with its model layer.
        folder: Where checkpoints are written.
        tasks: Models and seeds, none twice.
        jobs: Processes; 1 is this process.
        device: ``cpu``, ``cuda`` or ``auto``.
        on_epoch: Called in this process after every epoch of every task.

    Returns:
        Checkpoints in the order of the tasks.

    Raises:
        UsageError: As `train_model`, or two tasks have one name.
        DatasetError: As `train_model`.
        WorkerError: A worker process died.
        KeyboardInterrupt: The user interrupted; every training can go on.
    """
    layer, paths = open_model(release), [task.path(Path(folder)) for task in tasks]
    if len(set(paths)) < len(tasks):
        raise UsageError(f"two of {len(tasks)} tasks have one model, seed and fold; give each model its own name")
    watch, there = on_epoch or _unseen, [path.exists() for path in paths]
    missing = [task for task, is_there in zip(tasks, there, strict=True) if not is_there]
    if min(jobs, len(missing)) <= 1:
        with deferred_interrupt() as raise_if_noted:

            def between(report: EpochReport) -> None:
                watch(report)
                raise_if_noted()

            return [task.train(layer, folder, device, between) for task in tasks]
    for task in itertools.compress(tasks, there):
        task.train(layer, folder, device, watch)  # which trains nothing, and refuses what is of another training
    _in_workers(str(release), str(folder), missing, min(jobs, len(missing)), device, watch)
    return [read_checkpoint(path) for path in paths]


def _unseen(report: EpochReport) -> None:
    """Nobody watches."""


def _in_workers(
    release: str, folder: str, tasks: Sequence[Task], jobs: int, device: str, watch: Callable[[EpochReport], None]
) -> None:
    with deferred_interrupt() as raise_if_noted:  # half an event or queue leaks semaphores
        context = spawn_context()
        stop, reports = context.Event(), context.SimpleQueue()
    raise_if_noted()
    watcher = _Watcher(reports, watch, stop)
    watcher.start()
    is_broken = False
    state = _Worker(release, folder, device, stop, reports)
    try:
        with started_workers(context, jobs, stop, _Worker.start, state) as workers:
            running = {workers.submit(_Worker.train, task) for task in _longest_first(tasks)}
            while running:
                finished, running = workers.wait(running)
                for future in finished:
                    future.result()
    except WorkerError:
        is_broken = True
        raise
    except _StoppedError:
        pass  # because the watcher raised
    finally:
        if not is_broken:  # a process that died may hold the lock of the queue
            reports.put(None)
            watcher.join()
            reports.close()
    if watcher.error is not None:
        raise watcher.error


class _Watcher(threading.Thread):
    """Passes on what workers report; if the one who watches raises, they are asked to stop."""

    def __init__(
        self, reports: SimpleQueue[EpochReport | None], watch: Callable[[EpochReport], None], stop: Event
    ) -> None:
        super().__init__(daemon=True)
        self.error: BaseException | None = None
        self._reports, self._watch, self._stop_event = reports, watch, stop

    def run(self) -> None:
        while (report := self._reports.get()) is not None:
            if self.error is None:
                try:
                    self._watch(report)
                except BaseException as error:  # raised again by who waits
                    self.error = error
                    self._stop_event.set()


def _longest_first(tasks: Sequence[Task]) -> list[Task]:
    """Tasks that read images before those of histories and others, so that no process ends with a long one alone."""

    def briefness(task: Task) -> tuple[int, bool]:
        model = task.configuration.model
        return -len(model.images), model.history is None

    return sorted(tasks, key=briefness)


class _StoppedError(Exception):
    """A worker stopped after an epoch; nobody waits for its checkpoint any more."""


@dataclass
class _Worker:
    """What a worker process knows; `current` is the one of this process."""

    release: str
    folder: str
    device: str
    stop: Event
    reports: SimpleQueue[EpochReport | None]

    current: ClassVar[_Worker]

    @cached_property
    def layer(self) -> ModelLayer:
        return open_model(self.release)

    def start(self) -> None:
        _Worker.current = self

    def between(self, report: EpochReport) -> None:
        self.reports.put(report)
        if self.stop.is_set():
            raise _StoppedError

    @staticmethod
    def train(task: Task) -> None:
        worker = _Worker.current
        if worker.stop.is_set():
            raise _StoppedError
        task.train(worker.layer, worker.folder, worker.device, worker.between)
