"""Executing groups in this process or in worker processes.

Which process executes a group never changes its bytes. Asked to stop, a worker stops before the next rollout.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from concurrent.futures import Future
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import ClassVar

from branchdrive.contract.descriptor import Descriptor
from branchdrive.environment import leave_out_pandas
from branchdrive.process import spawn_context
from branchdrive.writer.group_writer import GroupWriter
from branchdrive_reference.collect.group import GroupReport, collect_group
from branchdrive_reference.collect.interrupt import deferred_interrupt
from branchdrive_reference.collect.plan import GroupPlan
from branchdrive_reference.collect.workers import started_workers

__all__ = ["execute_groups", "num_workers"]

_GROUPS_PER_WORKER = 2
"""Groups that are handed out at a time for every worker."""


def execute_groups(
    root: Path, descriptor: Descriptor, plans: Sequence[GroupPlan], *, jobs: int
) -> Generator[GroupReport, None, None]:
    """Collect and close the planned groups; yields their reports in the order in which they are finished.

    Closing the generator stops the workers and waits for them.

    Raises:
        WorkerError: A worker process died.
        KeyboardInterrupt: The user interrupted; all finished rollouts are kept.
    """
    if num_workers(len(plans), jobs=jobs) == 1:
        with deferred_interrupt() as raise_if_noted:
            for plan in plans:
                with GroupWriter(root, descriptor, plan.group_id, plan.index) as writer:
                    report = collect_group(writer, descriptor, plan, between=raise_if_noted)
                yield report
                raise_if_noted()
    else:
        yield from _in_workers(root, descriptor, plans, jobs)


def num_workers(num_groups: int, *, jobs: int) -> int:
    """Processes that work on `num_groups` groups if `jobs` may; 1 is this process."""
    return max(1, min(jobs, num_groups))


def _in_workers(
    root: Path, descriptor: Descriptor, plans: Sequence[GroupPlan], jobs: int
) -> Generator[GroupReport, None, None]:
    waiting = list(reversed(plans))
    running: set[Future[GroupReport]] = set()
    with deferred_interrupt() as raise_if_noted:  # half an event leaks semaphores
        context = spawn_context()
        stop = context.Event()
    raise_if_noted()
    state = (root, descriptor.model_dump_json(), stop)
    with started_workers(context, num_workers(len(plans), jobs=jobs), stop, _Worker.start, *state) as workers:
        while waiting or running:
            while waiting and len(running) < _GROUPS_PER_WORKER * jobs:
                running.add(workers.submit(_Worker.collect, waiting.pop()))
            finished, running = workers.wait(running)
            for future in finished:
                yield future.result()


class _StoppedError(Exception):
    """A worker stopped between two rollouts; nobody waits for its group any more."""


class _Worker:
    """State of a worker process; never instantiated."""

    root: ClassVar[Path]
    descriptor: ClassVar[Descriptor]
    stop: ClassVar[Event]

    @classmethod
    def start(cls, root: Path, descriptor_json: str, stop: Event) -> None:
        leave_out_pandas()
        cls.root, cls.stop = root, stop
        cls.descriptor = Descriptor.model_validate_json(descriptor_json)

    @classmethod
    def collect(cls, plan: GroupPlan) -> GroupReport:
        cls.raise_if_stopped()
        with GroupWriter(cls.root, cls.descriptor, plan.group_id, plan.index) as writer:
            return collect_group(writer, cls.descriptor, plan, between=cls.raise_if_stopped)

    @classmethod
    def raise_if_stopped(cls) -> None:
        if cls.stop.is_set():
            raise _StoppedError
