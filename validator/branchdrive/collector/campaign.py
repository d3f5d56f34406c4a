"""A whole collection: execute what is missing, commit shards in order, finish the dataset."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import TypeVar

import numpy as np

from branchdrive.collector.pool import Execute, Planned, execute_groups, num_workers
from branchdrive.collector.report import CollectionReport, GroupReport
from branchdrive.driving.route_cluster import CLUSTER_POINTS, resample_polyline, route_clusters
from branchdrive.errors import UsageError
from branchdrive.raw.reader import open_dataset
from branchdrive.raw.rollout import ROLLOUTS
from branchdrive.writer.writer import DatasetWriter

__all__ = ["check_begun", "run_campaign"]

_Plan = TypeVar("_Plan", bound=Planned)


def _ignore(*_: object) -> None:
    """Nobody watches."""


def check_begun(writer: DatasetWriter, num_groups: int) -> None:
    """Refuse to go on with fewer groups than a collection was begun with.

    Raises:
        UsageError: A group beyond the first `num_groups` was begun.
    """
    begun = max(writer.places.values(), default=-1) + 1
    if begun > num_groups:
        raise UsageError(
            f"{writer.root}: this collection has begun {begun} groups, more than the {num_groups} asked for; "
            f"ask for at least {begun}, or choose another folder"
        )


def run_campaign(
    writer: DatasetWriter,
    plans: Sequence[_Plan],
    execute: Execute[_Plan, GroupReport],
    *,
    jobs: int = 1,
    prepare: Callable[[int], None] = _ignore,
    watch: Callable[[int, int], None] = _ignore,
) -> CollectionReport:
    """Collect the planned groups that are not finished, and finish the dataset.

    The bytes depend on the plans alone: not on `jobs`, nor on where an earlier run was interrupted.

    Args:
        writer: The dataset, open.
        plans: All groups of the dataset, by place.
        execute: What collects a group; see `execute_groups`.
        jobs: Worker processes; 1 works in this process.
        prepare: Called with the number of groups that are missing, if there are any, before the first of them.
        watch: Called with the number of finished groups and of ticks executed by this run, at the beginning and after
            every group.

    Raises:
        UsageError: The dataset is finished with fewer groups, which keeps its version.
        WorkerError: A worker process died.
        KeyboardInterrupt: The user interrupted; whatever was finished is kept.
    """
    begin_s = time.perf_counter()
    missing = [plan for plan in plans if not writer.is_closed(plan.group_id)]
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
    with closing(execute_groups(writer.root, writer.descriptor, missing, execute, jobs=jobs)) as finished:
        for report in finished:
            reports.append(report)
            num_ticks += report.num_ticks
            writer.commit()
            watch(num_found + len(reports), num_ticks)
    identity = writer.finalize()
    workers = num_workers(len(missing), jobs=jobs)
    seconds = time.perf_counter() - begin_s
    return CollectionReport(tuple(reports), num_found, workers, seconds, identity, *_routes(writer.root))


def _routes(root: Path) -> tuple[int, int]:
    """Branched groups of a finished dataset, and the clusters of their routes."""
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
