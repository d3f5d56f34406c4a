"""Executing groups in this process or in worker processes.

Which process executes a group never changes its bytes. A worker ends at once when its parent dies or
gives it up, so that an interrupted collection can be resumed immediately; asked to stop, it stops
before the next rollout. Workers leave interrupts and requests to terminate to the parent.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import ClassVar

from branchdrive.contract.descriptor import Descriptor
from branchdrive.dataset.group_writer import GroupWriter
from branchdrive.errors import ToolError
from branchdrive.process import spawn_context
from branchdrive_reference.collect.group import GroupReport, collect_group
from branchdrive_reference.collect.interrupt import deferred_interrupt, shielded_children
from branchdrive_reference.collect.plan import GroupPlan

__all__ = ["execute_groups", "num_workers"]

_GROUPS_PER_WORKER = 2
"""Groups that are handed out at a time for every worker."""


def execute_groups(
    root: Path, descriptor: Descriptor, plans: Sequence[GroupPlan], *, jobs: int
) -> Generator[GroupReport, None, None]:
    """Collect and close the planned groups; yields their reports in the order in which they are finished.

    Closing the generator stops the workers and waits for them.

    Raises:
        ToolError: A worker process died.
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
    with deferred_interrupt() as raise_if_noted:  # half a pool leaks semaphores
        context = spawn_context()
        stop = context.Event()
        watched, lifeline = context.Pipe(duplex=False)  # its other end closes with this process, however that ends
        pool = ProcessPoolExecutor(
            num_workers(len(plans), jobs=jobs),
            context,
            _Worker.start,
            (root, descriptor.model_dump_json(), stop, watched),
        )
    try:
        raise_if_noted()
        while waiting or running:
            with shielded_children():  # they are started as work is handed out
                while waiting and len(running) < _GROUPS_PER_WORKER * jobs:
                    running.add(pool.submit(_Worker.collect, waiting.pop()))
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                yield future.result()
    except BrokenProcessPool as error:
        lifeline.close()  # the other workers do not hear the pool's request to terminate
        raise ToolError(
            "a worker process died; make room in memory or use fewer `--jobs`, and run the same command again to go on"
        ) from error
    finally:
        stop.set()
        with deferred_interrupt(then=lifeline.close) as raise_if_noted:  # who insists does not wait for rollouts
            pool.shutdown(wait=True, cancel_futures=True)
        lifeline.close()
        watched.close()
        raise_if_noted()


class _StoppedError(Exception):
    """A worker stopped between two rollouts; nobody waits for its group any more."""


class _Worker:
    """State of a worker process; never instantiated."""

    root: ClassVar[Path]
    descriptor: ClassVar[Descriptor]
    stop: ClassVar[Event]

    @classmethod
    def start(cls, root: Path, descriptor_json: str, stop: Event, watched: Connection) -> None:
        threading.Thread(target=_exit_with_parent, args=(watched,), daemon=True).start()
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


def _exit_with_parent(watched: Connection) -> None:
    watched.poll(None)  # nothing is ever sent
    os._exit(1)
