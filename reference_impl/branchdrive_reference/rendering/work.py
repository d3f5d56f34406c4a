"""Rendering groups in this process or in worker processes; which one it is changes no byte."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from branchdrive.raw.reader import open_dataset
from branchdrive.runtime.environment import leave_out_pandas
from branchdrive.runtime.executor import Executor
from branchdrive.runtime.workers import run_each
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


def render_groups(
    root: Path, plan: MediaPlan, tasks: Sequence[Task], *, jobs: int, executor: Executor | None = None
) -> Generator[Task, None, None]:
    """Render groups of the dataset at `root` in processes, or by an executor; yields those that are finished.

    Raises:
        UsageError: What is recorded of a group cannot be drawn.
        DatasetError: A file of the dataset cannot be read.
        ToolError: A worker process died.
        KeyboardInterrupt: The user interrupted; finished groups are kept.
    """
    return run_each(_Rendering(root, plan), tasks, jobs=jobs, executor=executor, start=leave_out_pandas)


@dataclass(frozen=True)
class _Rendering:
    """Renders a group in whichever process."""

    root: Path
    plan: MediaPlan

    @cached_property
    def renderer(self) -> GroupRenderer:
        return GroupRenderer(open_dataset(self.root), self.plan)

    def __call__(self, task: Task, between: Callable[[], None]) -> Task:
        self.renderer.write_piece(*task, between=between)
        return task
