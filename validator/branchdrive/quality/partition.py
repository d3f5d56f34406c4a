"""The split of a release: clusters of routes, the drawn partitions, and their columns and document.

Partitions are drawn over integrity-complete groups, before any threshold is fitted. The document freezes
the assignment by its digest; the assignment itself is in the table `group_quality`.

Source: paper, "Evaluation Population"; spec/11-fidelity.md#split.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from branchdrive.contract.text import counted, listed
from branchdrive.driving.route_cluster import route_clusters
from branchdrive.statistics.split import (
    CALIBRATION,
    DIVIDED,
    SHARES,
    STRATIFIED,
    Calibration,
    assign_split,
    split_digest,
)
from branchdrive.tables.frame import Frame, Values

__all__ = [
    "ALGORITHMS", "PARTITIONS", "algorithm_for", "assignment_of", "calibration_of", "cluster_of_groups", "clusters_of",
    "draw_assignment", "partition_sizes", "split_document", "with_assignment",
]  # fmt: skip

ALGORITHMS = (STRATIFIED, DIVIDED)
"""Names of the algorithms that `assign_split` describes."""

PARTITIONS = (*SHARES, CALIBRATION)
"""Partitions in the order in which documents and texts name them."""


def cluster_of_groups(group_ids: Sequence[str], towns: Sequence[str], routes: ArrayLike) -> dict[str, int]:
    """Route cluster of every group, numbered from 0 in order of the sorted group ids.

    Args:
        group_ids: Groups ``[groups]``, all different, in any order.
        towns: Town of each ``[groups]``.
        routes: Resampled route of each ``[groups, 32, 2]``, metres in the frame of the town.

    Raises:
        ValueError: The inputs differ in length, or a group is given twice.
    """
    points = np.asarray(routes, np.float64)
    if not len(group_ids) == len(towns) == len(points):
        raise ValueError(f"{len(group_ids)} groups, {len(towns)} towns and {len(points)} routes do not match")
    if len(set(group_ids)) != len(group_ids):
        raise ValueError("a group is given twice")
    if not len(points):
        return {}
    order = sorted(range(len(group_ids)), key=group_ids.__getitem__)
    labels = route_clusters([towns[i] for i in order], points[order])
    return {group_ids[i]: int(label) for i, label in zip(order, labels, strict=True)}


def draw_assignment(
    groups: Frame,
    clusters: Mapping[str, int],
    *,
    seed: int,
    calibration: Calibration | None = None,
    algorithm: str | None = None,
) -> dict[str, str]:
    """Partition of every integrity-complete group, by group id in sorted order.

    Args:
        groups: Rows of `group_quality`, of which `group_id`, `scenario_type` and `integrity_complete` are read.
        clusters: Route cluster of every integrity-complete group.
        seed: Part of the key of the draw.
        calibration: The least that a calibration partition must hold; without it there is none.
        algorithm: One of `ALGORITHMS`; `algorithm_for` by default.

    Raises:
        ValueError: A group has no cluster, or there are too few groups or clusters to fill every partition.
    """
    complete = np.asarray(groups["integrity_complete"], np.bool_)
    group_ids = groups["group_id"][complete].tolist()
    _check_same(group_ids, "a route cluster", clusters)
    labels = [clusters[group_id] for group_id in group_ids]
    assignment = assign_split(
        group_ids,
        labels,
        groups["scenario_type"][complete].tolist(),
        seed=seed,
        calibration=calibration,
        algorithm=algorithm or algorithm_for(calibration),
    )
    empty = [name for name in SHARES if name not in assignment.values()]
    if empty:
        there = f"{counted(len(group_ids), 'integrity-complete group')} in {counted(len(set(labels)), 'route cluster')}"
        raise ValueError(f"{there} leave no group to {listed(empty)}; a cluster is never divided")
    return assignment


def algorithm_for(calibration: Calibration | None) -> str:
    """Algorithm of a new split; without calibration both are the same, and the first one is named."""
    return STRATIFIED if calibration is None else DIVIDED


def with_assignment(groups: Frame, clusters: Mapping[str, int], assignment: Mapping[str, str]) -> dict[str, Values]:
    """Rows of `group_quality` with the columns `partitioned`, `route_cluster` and `partition`.

    Args:
        groups: Rows, of which `group_id` and `integrity_complete` are read.
        clusters: Route cluster of every integrity-complete group.
        assignment: Partition of every integrity-complete group.

    Raises:
        ValueError: Integrity-complete groups and those that have a cluster or partition are not the same.
    """
    complete = np.asarray(groups["integrity_complete"], np.bool_)
    group_ids = groups["group_id"].tolist()
    wanted = groups["group_id"][complete].tolist()
    _check_same(wanted, "a route cluster", clusters)
    _check_same(wanted, "a partition", assignment)
    labels = np.array([clusters.get(group_id, 0) for group_id in group_ids], np.int32)
    names = np.array([assignment.get(group_id, "") for group_id in group_ids], object)
    return {
        **groups,
        "partitioned": complete,
        "route_cluster": np.ma.masked_array(labels, ~complete),
        "partition": np.ma.masked_array(names, ~complete),
    }


def _check_same(wanted: Sequence[str], noun: str, given: Mapping[str, Any]) -> None:
    unmatched = sorted(set(wanted) ^ set(given))
    if unmatched:
        side = "has none" if unmatched[0] in set(wanted) else "is none of them"
        raise ValueError(f"integrity-complete groups and groups with {noun} are not the same: {unmatched[0]!r} {side}")


def split_document(
    assignment: Mapping[str, str], clusters: Mapping[str, int], *, seed: int, calibration: Calibration | None = None
) -> dict[str, Any]:
    """The document ``split.json`` of a drawn assignment.

    Args:
        assignment: Partition by group id.
        clusters: Route cluster of the same groups.
        seed: Seed of the draw.
        calibration: The least that was asked of the calibration partition, if there is one.
    """
    return {
        "algorithm": algorithm_for(calibration),
        "seed": seed,
        "shares": dict(SHARES),
        "calibration": None if calibration is None else calibration._asdict(),
        "num_clusters": len({clusters[group_id] for group_id in assignment}),
        "partitions": partition_sizes(assignment, clusters),
        "digest": split_digest(assignment),
    }


def partition_sizes(assignment: Mapping[str, str], clusters: Mapping[str, int]) -> dict[str, dict[str, int]]:
    """Groups and clusters of every partition that has a group."""
    members: dict[str, list[int]] = {}
    for group_id, name in assignment.items():
        members.setdefault(name, []).append(clusters[group_id])
    order = [*PARTITIONS, *sorted(members.keys() - set(PARTITIONS))]
    return {
        name: {"groups": len(members[name]), "clusters": len(set(members[name]))} for name in order if name in members
    }


def assignment_of(groups: Frame) -> dict[str, str]:
    """Partition by group id, of the rows of `group_quality` that have one."""
    return _of_rows(groups, "partition")


def clusters_of(groups: Frame) -> dict[str, int]:
    """Route cluster by group id, of the rows of `group_quality` that have one."""
    return _of_rows(groups, "route_cluster")


def _of_rows(groups: Frame, column: str) -> dict[str, Any]:
    there = ~np.ma.getmaskarray(groups[column])
    return dict(zip(groups["group_id"][there].tolist(), np.ma.getdata(groups[column])[there].tolist(), strict=True))


def calibration_of(document: Mapping[str, Any]) -> Calibration | None:
    """What a document ``split.json`` asks of its calibration partition."""
    least = document["calibration"]
    return None if least is None else Calibration(int(least["min_groups"]), int(least["min_clusters"]))
