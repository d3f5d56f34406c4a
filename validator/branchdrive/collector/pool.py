"""Executing groups in this process or in worker processes.

Which process executes a group never changes its bytes. Asked to stop, a worker stops before the next rollout.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

from branchdrive.contract.descriptor import Descriptor
from branchdrive.environment import leave_out_pandas
from branchdrive.interrupt import deferred_interrupt
from branchdrive.process import spawn_context
from branchdrive.workers import started_workers
from branchdrive.writer.group_writer import GroupWriter

__all__ = ["Execute", "Planned", "execute_groups", "num_workers"]


class Planned(Protocol):
    """A group that is to be collected; processes hand it to each other."""

    @property
    def index(self) -> int:
        """Place in the dataset, from 0."""

    @property
    def group_id(self) -> str:
        """Identity of the group."""


_Plan = TypeVar("_Plan", bound=Planned)
_PlanTaken = TypeVar("_PlanTaken", bound=Planned, contravariant=True)
_Report = TypeVar("_Report")
_ReportGiven = TypeVar("_ReportGiven", covariant=True)


class Execute(Protocol[_PlanTaken, _ReportGiven]):
    """Executes what is missing of a group; a function of a module, or an object, that can be pickled."""

    def __call__(
        self, writer: GroupWriter, descriptor: Descriptor, plan: _PlanTaken, *, between: Callable[[], None]
    ) -> _ReportGiven:
        """Write the group's rollouts; `between` is called before each, and an exception from it is passed on."""


def execute_groups(
    root: Path, descriptor: Descriptor, plans: Sequence[_Plan], execute: Execute[_Plan, _Report], *, jobs: int
) -> Generator[_Report, None, None]:
    """Collect and close the planned groups; yields their reports in the order in which they are finished.

    Closing the generator stops the workers and waits for them.

    Args:
        root: Folder of the dataset, which a `DatasetWriter` has opened.
        descriptor: The dataset's descriptor.
        plans: The groups.
        execute: What collects a group.
        jobs: Worker processes; 1 works in this process.

    Raises:
        WorkerError: A worker process died.
        KeyboardInterrupt: The user interrupted; all finished rollouts are kept.
    """
    if num_workers(len(plans), jobs=jobs) == 1:
        with deferred_interrupt() as raise_if_noted:
            for plan in plans:
                with GroupWriter(root, descriptor, plan.group_id, plan.index) as writer:
                    report = execute(writer, descriptor, plan, between=raise_if_noted)
                yield report
                raise_if_noted()
    else:
        yield from _in_workers(root, descriptor, plans, execute, jobs)


def num_workers(num_groups: int, *, jobs: int) -> int:
    """Processes that work on `num_groups` groups if `jobs` may; 1 is this process."""
    return max(1, min(jobs, num_groups))


def _in_workers(
    root: Path, descriptor: Descriptor, plans: Sequence[_Plan], execute: Execute[_Plan, _Report], jobs: int
) -> Generator[_Report, None, None]:
    with deferred_interrupt() as raise_if_noted:  # half an event leaks semaphores
        context = spawn_context()
        stop = context.Event()
    raise_if_noted()
    state = (root, descriptor.model_dump_json(), execute, stop)
    with started_workers(context, num_workers(len(plans), jobs=jobs), stop, _Worker.start, *state) as workers:
        yield from workers.results(_Worker.collect, plans)


class _StoppedError(Exception):
    """A worker stopped between two rollouts; nobody waits for its group any more."""


class _Worker:
    """State of a worker process; never instantiated."""

    root: ClassVar[Path]
    descriptor: ClassVar[Descriptor]
    execute: ClassVar[Execute[Any, Any]]
    stop: ClassVar[Event]

    @classmethod
    def start(cls, root: Path, descriptor_json: str, execute: Execute[Any, Any], stop: Event) -> None:
        leave_out_pandas()
        cls.root, cls.execute, cls.stop = root, staticmethod(execute), stop
        cls.descriptor = Descriptor.model_validate_json(descriptor_json)

    @classmethod
    def collect(cls, plan: Planned) -> Any:
        cls.raise_if_stopped()
        with GroupWriter(cls.root, cls.descriptor, plan.group_id, plan.index) as writer:
            return cls.execute(writer, cls.descriptor, plan, between=cls.raise_if_stopped)

    @classmethod
    def raise_if_stopped(cls) -> None:
        if cls.stop.is_set():
            raise _StoppedError
