"""A whole collection: execute what is missing, commit shards in order, finish the dataset.

Which process executes a group never changes its bytes. Asked to stop, a worker stops before the next rollout.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np

from branchdrive.collector.report import CollectionReport, GroupReport
from branchdrive.contract.descriptor import Descriptor
from branchdrive.driving.route_cluster import CLUSTER_POINTS, resample_polyline, route_clusters
from branchdrive.errors import UsageError
from branchdrive.raw.reader import open_dataset
from branchdrive.raw.rollout import ROLLOUTS
from branchdrive.runtime.elsewhere import unseen_error
from branchdrive.runtime.environment import leave_out_pandas
from branchdrive.runtime.executor import Executor
from branchdrive.runtime.progress import unwatched
from branchdrive.runtime.workers import num_workers, run_each
from branchdrive.writer.group_writer import GroupWriter
from branchdrive.writer.writer import DatasetWriter

__all__ = ["Execute", "Planned", "check_begun", "count_routes", "run_campaign"]


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
_ReportGiven = TypeVar("_ReportGiven", covariant=True)


class Execute(Protocol[_PlanTaken, _ReportGiven]):
    """Executes what is missing of a group; a function of a module, or an object, that can be pickled."""

    def __call__(
        self, writer: GroupWriter, descriptor: Descriptor, plan: _PlanTaken, *, between: Callable[[], None]
    ) -> _ReportGiven:
        """Write the group's rollouts; `between` is called before each, and an exception from it is passed on."""


@dataclass(frozen=True)
class _Collecting:
    """Collects and closes a group."""

    root: Path
    descriptor: Descriptor
    execute: Execute[Any, GroupReport]

    def __call__(self, plan: Planned, between: Callable[[], None]) -> GroupReport:
        with GroupWriter(self.root, self.descriptor, plan.group_id, plan.index) as writer:
            return self.execute(writer, self.descriptor, plan, between=between)


def check_begun(writer: DatasetWriter, num_groups: int, plans: Sequence[Planned]) -> None:
    """Refuse to go on with fewer groups than a collection was begun with, or with those of another part.

    Args:
        writer: The dataset.
        num_groups: Groups of the whole collection.
        plans: Those of them that this run collects.

    Raises:
        UsageError: A group beyond the first `num_groups`, or one that is not planned, was begun.
    """
    places = writer.places
    begun = max(places.values(), default=-1) + 1
    if begun > num_groups:
        raise UsageError(
            f"{writer.root}: this collection has begun {begun} groups, more than the {num_groups} asked for; "
            f"ask for at least {begun}, or choose another folder"
        )
    others = places.keys() - {plan.group_id for plan in plans} if len(plans) < num_groups else ()
    if others:
        raise UsageError(
            f"{writer.root}: this collection has begun group {min(others)!r}, which is of another part; ask for that "
            "part, or choose another folder"
        )


def run_campaign(
    writer: DatasetWriter,
    plans: Sequence[_Plan],
    execute: Execute[_Plan, GroupReport],
    *,
    jobs: int = 1,
    executor: Executor | None = None,
    prepare: Callable[[int], None] = unwatched,
    watch: Callable[[int, int], None] = unwatched,
) -> CollectionReport:
    """Collect the planned groups that are not finished, and finish the dataset.

    The bytes depend on the plans alone: not on `jobs`, nor on where an earlier run was interrupted.

    Args:
        writer: The dataset, open.
        plans: All groups of the dataset, or of a part of it, by place.
        execute: What collects a group.
        jobs: Worker processes; 1 works in this process.
        executor: What collects groups instead of these; the dataset's folder is on all of its machines.
        prepare: Called with the number of groups that are missing, if there are any, before the first of them.
        watch: Called with the number of finished groups and of ticks executed by this run, at the beginning and after
            every group.

    Raises:
        UsageError: The dataset is finished with fewer groups, which keeps its version.
        ToolError: A worker process died.
        PlatformError: Another machine has collected groups that this one does not see.
        KeyboardInterrupt: The user interrupted; whatever was finished is kept.
    """
    begin_s = time.perf_counter()
    closed = writer.closed
    missing = [plan for plan in plans if plan.group_id not in closed]
    num_found = len(plans) - len(missing)
    if writer.is_finished and missing:
        raise UsageError(
            f"{writer.root}: is a finished dataset of {num_found} groups, which stays as it is; "
            f"choose another folder to collect {len(plans)}"
        )
    if missing:
        prepare(len(missing))
    reports: list[GroupReport] = []
    num_ticks = 0
    watch(num_found, num_ticks)
    collecting = _Collecting(writer.root, writer.descriptor, execute)
    with closing(run_each(collecting, missing, jobs=jobs, executor=executor, start=leave_out_pandas)) as finished:
        for report in finished:
            reports.append(report)
            num_ticks += report.num_ticks
            writer.commit()
            watch(num_found + len(reports), num_ticks)
    if unseen := {plan.group_id for plan in missing} - writer.closed:
        raise unseen_error(f"{writer.root}: group {min(unseen)!r}")
    identity = writer.finalize()
    workers = num_workers(len(missing), jobs=jobs)
    seconds = time.perf_counter() - begin_s
    return CollectionReport(tuple(reports), num_found, workers, seconds, identity, *count_routes(writer.root))


def count_routes(root: Path) -> tuple[int, int]:
    """Branched groups of a finished dataset, and the clusters of their routes.

    Raises:
        DatasetError: A table cannot be read.
    """
    towns: list[str] = []
    lines = []
    for table in open_dataset(root).table(ROLLOUTS):
        branched = table.filter(table.column("branch_tick").is_valid())
        firsts = np.unique(branched.column("group_id").to_numpy(), return_index=True)[1]
        rows = branched.select(["town", "route_x_m", "route_y_m"]).take(firsts).to_pylist()
        towns += [row["town"] for row in rows]
        lines += [resample_polyline(row["route_x_m"], row["route_y_m"]) for row in rows]
    points = np.array(lines).reshape(len(lines), CLUSTER_POINTS, 2)
    return len(towns), len(set(route_clusters(towns, points).tolist()))
