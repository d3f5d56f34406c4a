"""Rendering groups in this process or in worker processes; which one it is changes no byte."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import ClassVar, NamedTuple

from branchdrive.environment import leave_out_pandas
from branchdrive.interrupt import deferred_interrupt
from branchdrive.process import spawn_context
from branchdrive.raw.reader import open_dataset
from branchdrive.workers import started_workers
from branchdrive_reference.rendering.group import GroupRenderer
from branchdrive_reference.rendering.plan import MediaPlan

__all__ = ["Task", "render_groups"]


class Task(NamedTuple):
    """A group that is to be rendered into a piece.

    Attributes:
        folder: Where the pieces of its shard are.
        shard: Index of its shard.
        number: Its place in the shard.
        group_id: The group.
    """

    folder: Path
    shard: int
    number: int
    group_id: str


def render_groups(root: Path, plan: MediaPlan, tasks: Sequence[Task], *, jobs: int) -> Generator[Task, None, None]:
    """Render groups of the dataset at `root`; yields those that are finished.

    Raises:
        UsageError: What is recorded of a group cannot be drawn.
        DatasetError: A file of the dataset cannot be read.
        WorkerError: A worker process died.
        KeyboardInterrupt: The user interrupted; finished groups are kept.
    """
    if jobs == 1 or len(tasks) <= 1:
        renderer = GroupRenderer(open_dataset(root), plan)
        with deferred_interrupt() as raise_if_noted:
            for task in tasks:
                renderer.write_piece(*task, between=raise_if_noted)
                yield task
                raise_if_noted()
        return
    with deferred_interrupt() as raise_if_noted:  # half an event leaks semaphores
        context = spawn_context()
        stop = context.Event()
    raise_if_noted()
    with started_workers(context, min(jobs, len(tasks)), stop, _Worker.start, root, plan, stop) as workers:
        yield from workers.results(_Worker.render, tasks)


class _StoppedError(Exception):
    """A worker stopped between two rollouts; nobody waits for its group any more."""


class _Worker:
    """State of a worker process; never instantiated."""

    renderer: ClassVar[GroupRenderer]
    stop: ClassVar[Event]

    @classmethod
    def start(cls, root: Path, plan: MediaPlan, stop: Event) -> None:
        leave_out_pandas()
        cls.renderer, cls.stop = GroupRenderer(open_dataset(root), plan), stop

    @classmethod
    def render(cls, task: Task) -> Task:
        cls.renderer.write_piece(*task, between=cls.raise_if_stopped)
        return task

    @classmethod
    def raise_if_stopped(cls) -> None:
        if cls.stop.is_set():
            raise _StoppedError
