"""Split rules: partitions are disjoint, complete and frozen, and are the ones that were drawn.

What is wrong with a stored split is a function for each concern. Every one reads the document ``split.json``, which
conforms to its schema, the stored rows of `group_quality`, whose group ids are unique, or both.

Source: paper, "Evaluation Population"; spec/11-fidelity.md#split.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from branchdrive.contract.mismatch import Check, Location, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.layers.compare import document_check, place_in_table
from branchdrive.layers.view import ReleaseView
from branchdrive.quality.partition import (
    ALGORITHMS,
    PARTITIONS,
    assignment_of,
    calibration_of,
    cluster_of_groups,
    clusters_of,
    draw_assignment,
    partition_sizes,
)
from branchdrive.statistics.split import CALIBRATION, SHARES, Calibration, split_digest
from branchdrive.tables.frame import Frame, num_rows

__all__ = [
    "calibration_mismatches",
    "cluster_mismatches",
    "count_mismatches",
    "digest_mismatches",
    "draw_mismatches",
    "empty_mismatches",
    "membership_mismatches",
]

SPLIT = "quality/split.json"


def _of_groups(view: ReleaseView, examined: int, mismatches: Iterable[Mismatch]) -> Check:
    where = place_in_table(view, "group_quality")
    return Check.of(examined, (found.within(where) for found in mismatches))


@rule("BD-SPL-001")
def complete_groups_have_a_partition(view: ReleaseView) -> Iterator[Check]:
    """Every integrity-complete group has a partition and a cluster, and no other group has."""
    groups = view.frame("group_quality")
    yield _of_groups(view, num_rows(groups), membership_mismatches(groups))


@rule("BD-SPL-002")
def clusters_recompute(view: ReleaseView) -> Iterator[Check]:
    """Route clusters by geometry, numbered in order of the sorted groups."""
    found, routes = clusters_of(view.frame("group_quality")), view.raw_rows["routes"]
    expected = cluster_of_groups(routes["group_id"].tolist(), routes["town"].tolist(), routes["points"])
    both = sorted(expected.keys() & found.keys())
    mismatches = (
        Mismatch({"group_id": group_id}, f"route cluster {expected[group_id]}", f"route cluster {found[group_id]}")
        for group_id in both
        if expected[group_id] != found[group_id]
    )
    yield _of_groups(view, len(both), mismatches)


@rule("BD-SPL-003")
def clusters_lie_in_one_partition(view: ReleaseView) -> Iterator[Check]:
    """All groups of a route cluster are in one partition."""
    groups = view.frame("group_quality")
    yield _of_groups(view, len(set(clusters_of(groups).values())), cluster_mismatches(groups))


@rule("BD-SPL-004")
def split_digest_recomputes(view: ReleaseView) -> Iterator[Check]:
    """The digest is that of the stored assignment: a group that moved, or is in two partitions, changes it."""
    document, groups = view.document(SPLIT), view.frame("group_quality")
    yield document_check(SPLIT, 1, digest_mismatches(document, groups))


@rule("BD-SPL-005")
def partitions_are_large_enough(view: ReleaseView) -> Iterator[Check]:
    """Training, validation and test have a group each, and calibration what was asked of it."""
    document, groups = view.document(SPLIT), view.frame("group_quality")
    yield document_check(SPLIT, 4, [*empty_mismatches(groups), *calibration_mismatches(document, groups)])


@rule("BD-SPL-006")
def split_counts_recompute(view: ReleaseView) -> Iterator[Check]:
    """Counts of groups and clusters are those of the stored assignment."""
    document, groups = view.document(SPLIT), view.frame("group_quality")
    yield document_check(SPLIT, 1 + 2 * len(document["partitions"]), count_mismatches(document, groups))


@rule("BD-SPL-008")
def split_is_the_drawn_one(view: ReleaseView) -> Iterator[Check]:
    """Drawing again from stored clusters and scenario types, by the stored seed, gives the stored partitions."""
    document, groups = view.document(SPLIT), view.frame("group_quality")
    algorithm = document["algorithm"]
    if algorithm not in ALGORITHMS:
        known = " and ".join(repr(name) for name in ALGORITHMS)
        raise PreconditionError(f"the split was drawn by {algorithm!r}; only {known} recompute")
    try:
        least = calibration_of(document)
        moved = list(draw_mismatches(groups, seed=int(document["seed"]), calibration=least, algorithm=algorithm))
    except ValueError as error:
        raise PreconditionError(f"the split cannot be drawn again: {error}") from error
    yield _of_groups(view, len(assignment_of(groups)), moved)


def membership_mismatches(groups: Frame) -> Iterator[Mismatch]:
    """Every integrity-complete group has a partition and a cluster, and no other group has."""
    assignment, clusters = assignment_of(groups), clusters_of(groups)
    rows = zip(
        groups["group_id"].tolist(), groups["integrity_complete"].tolist(), groups["partitioned"].tolist(), strict=True
    )
    for group_id, complete, partitioned in sorted(rows):
        name = assignment.get(group_id)
        at: Location = {"group_id": group_id}
        if complete and name not in PARTITIONS:
            yield Mismatch(at, f"a partition of {list(PARTITIONS)}", "none" if name is None else repr(name))
        elif not complete and name is not None:
            yield Mismatch(at, "no partition: it is not integrity-complete", repr(name))
        elif partitioned != complete or (group_id in clusters) != complete:
            has = f"partitioned {str(partitioned).lower()}, {'a' if group_id in clusters else 'no'} route cluster"
            expected = "partitioned true, a route cluster" if complete else "partitioned false, no route cluster"
            yield Mismatch(at, expected, has)


def cluster_mismatches(groups: Frame) -> Iterator[Mismatch]:
    """A route cluster lies in one partition; the mismatch is at its first group."""
    assignment = assignment_of(groups)
    homes: dict[int, dict[str, str]] = {}
    for group_id, cluster in sorted(clusters_of(groups).items()):
        if group_id in assignment:
            homes.setdefault(cluster, {}).setdefault(assignment[group_id], group_id)
    for cluster, home in homes.items():
        if len(home) > 1:
            names = ", ".join(f"{name} ({group_id})" for name, group_id in sorted(home.items()))
            wanted = f"one partition for all groups of route cluster {cluster}"
            yield Mismatch({"group_id": min(home.values())}, wanted, names)


def digest_mismatches(document: Mapping[str, Any], groups: Frame) -> Iterator[Mismatch]:
    """The digest is that of the stored assignment."""
    digest = split_digest(assignment_of(groups))
    if document["digest"] != digest:
        yield Mismatch({"pointer": "/digest"}, digest, str(document["digest"]))


def empty_mismatches(groups: Frame) -> Iterator[Mismatch]:
    """Training, validation and test have a group each."""
    present = set(assignment_of(groups).values())
    for name in SHARES:
        if name not in present:
            yield Mismatch({"pointer": f"/partitions/{name}"}, "at least 1 group", "0 groups")


def calibration_mismatches(document: Mapping[str, Any], groups: Frame) -> Iterator[Mismatch]:
    """The calibration partition holds what was asked of it, and exists only if it was."""
    least = calibration_of(document)
    counted = partition_sizes(*_both(groups)).get(CALIBRATION, {"groups": 0, "clusters": 0})
    has = f"{counted['groups']} groups in {counted['clusters']} route clusters"
    if least is None:
        if counted["groups"]:
            yield Mismatch({"pointer": "/calibration"}, "no calibration partition", has)
    elif counted["groups"] < least.min_groups or counted["clusters"] < least.min_clusters:
        wanted = f"at least {least.min_groups} groups in {least.min_clusters} route clusters"
        yield Mismatch({"pointer": "/calibration"}, wanted, has)


def count_mismatches(document: Mapping[str, Any], groups: Frame) -> Iterator[Mismatch]:
    """Counts of groups and clusters are those of the stored assignment."""
    assignment, clusters = _both(groups)
    counted, recorded = partition_sizes(assignment, clusters), document["partitions"]
    counts = [("/num_clusters", len({clusters[group_id] for group_id in assignment}), document["num_clusters"])]
    counts += [
        (f"/partitions/{name}/{unit}", counted.get(name, {}).get(unit, 0), recorded.get(name, {}).get(unit))
        for name in [*counted, *(name for name in recorded if name not in counted)]
        for unit in ("groups", "clusters")
    ]
    for pointer, count, it in counts:
        if it != count:
            yield Mismatch({"pointer": pointer}, str(count), "nothing" if it is None else str(it))


def draw_mismatches(
    groups: Frame, *, seed: int, calibration: Calibration | None = None, algorithm: str | None = None
) -> Iterator[Mismatch]:
    """Every group that has a partition is where the algorithm draws it, from the stored clusters and scenario types.

    Raises:
        ValueError: There is nothing to draw from: a group lacks its cluster, or there are too few groups.
    """
    drawn = draw_assignment(groups, clusters_of(groups), seed=seed, calibration=calibration, algorithm=algorithm)
    for group_id, name in sorted(assignment_of(groups).items()):
        if drawn.get(group_id) != name:
            wanted = f"partition {drawn.get(group_id, 'none')}"
            yield Mismatch({"group_id": group_id}, wanted, f"partition {name}")


def _both(groups: Frame) -> tuple[dict[str, str], dict[str, int]]:
    """Assignment and clusters of the groups that have both."""
    both = ~(np.ma.getmaskarray(groups["partition"]) | np.ma.getmaskarray(groups["route_cluster"]))
    kept = set(groups["group_id"][both].tolist())
    assignment, clusters = assignment_of(groups), clusters_of(groups)
    return {g: name for g, name in assignment.items() if g in kept}, {g: c for g, c in clusters.items() if g in kept}
