"""Executing groups in this process or in worker processes.

Which process executes a group never changes its bytes. A worker ends at once when its parent dies,
so that an interrupted collection can be resumed immediately; asked to stop, it stops before the
next rollout. Workers leave the keyboard interrupt to the parent.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection, get_context, parent_process
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import ClassVar

from branchdrive.contract.descriptor import Descriptor
from branchdrive.dataset.group_writer import GroupWriter
from branchdrive.errors import BranchDriveError
from branchdrive_reference.collect.group import GroupReport, collect_group
from branchdrive_reference.collect.interrupt import deferred_interrupt
from branchdrive_reference.collect.plan import GroupPlan

__all__ = ["execute_groups"]

_GROUPS_PER_WORKER = 2
"""Groups that are handed out at a time for every worker."""


def execute_groups(
    root: Path, descriptor: Descriptor, plans: Sequence[GroupPlan], *, jobs: int
) -> Generator[GroupReport, None, None]:
    """Collect and close the planned groups; yields their reports in the order in which they are finished.

    Closing the generator stops the workers and waits for them.

    Raises:
        BranchDriveError: A worker process died.
        KeyboardInterrupt: The user interrupted; all finished rollouts are kept.
    """
    if jobs == 1 or len(plans) <= 1:
        with deferred_interrupt() as raise_if_noted:
            for plan in plans:
                with GroupWriter(root, descriptor, plan.group_id, plan.index) as writer:
                    report = collect_group(writer, descriptor, plan, between=raise_if_noted)
                yield report
                raise_if_noted()
    else:
        yield from _in_workers(root, descriptor, plans, jobs)


def _in_workers(
    root: Path, descriptor: Descriptor, plans: Sequence[GroupPlan], jobs: int
) -> Generator[GroupReport, None, None]:
    context = get_context("spawn")
    stop = context.Event()
    waiting = list(reversed(plans))
    running: set[Future[GroupReport]] = set()
    pool = ProcessPoolExecutor(
        min(jobs, len(plans)), context, _Worker.start, (root, descriptor.model_dump_json(), stop)
    )
    try:
        while waiting or running:
            while waiting and len(running) < _GROUPS_PER_WORKER * jobs:
                running.add(pool.submit(_Worker.collect, waiting.pop()))
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                yield future.result()
    except BrokenProcessPool as error:
        raise BranchDriveError("a worker process died; run the same command again to go on from here") from error
    finally:
        stop.set()
        pool.shutdown(wait=True, cancel_futures=True)


class _StoppedError(Exception):
    """A worker stopped between two rollouts; nobody waits for its group any more."""


class _Worker:
    """State of a worker process; never instantiated."""

    root: ClassVar[Path]
    descriptor: ClassVar[Descriptor]
    stop: ClassVar[Event]

    @classmethod
    def start(cls, root: Path, descriptor_json: str, stop: Event) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        threading.Thread(target=_exit_with_parent, daemon=True).start()
        cls.root, cls.stop = root, stop
        cls.descriptor = Descriptor.model_validate_json(descriptor_json)

    @classmethod
    def collect(cls, plan: GroupPlan) -> GroupReport:
        with GroupWriter(cls.root, cls.descriptor, plan.group_id, plan.index) as writer:
            return collect_group(writer, cls.descriptor, plan, between=cls.raise_if_stopped)

    @classmethod
    def raise_if_stopped(cls) -> None:
        if cls.stop.is_set():
            raise _StoppedError


def _exit_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
