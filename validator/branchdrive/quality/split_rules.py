"""Split rules: partitions are disjoint, complete and frozen. Source: paper V-E; spec/11-fidelity.md#split."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from branchdrive.contract.mismatch import Check, Location, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.layers.compare import document_check
from branchdrive.layers.view import ReleaseView
from branchdrive.quality.partition import ALGORITHM, assignment_of, calibration_of, cluster_of_groups, clusters_of
from branchdrive.quality.split_check import (
    calibration_mismatches,
    cluster_mismatches,
    count_mismatches,
    digest_mismatches,
    draw_mismatches,
    empty_mismatches,
    membership_mismatches,
)
from branchdrive.tables.frame import num_rows

SPLIT = "quality/split.json"
TABLE: Location = {"file": "quality/group_quality.parquet", "table": "group_quality"}


def _of_groups(examined: int, mismatches: Iterable[Mismatch]) -> Check:
    return Check.of(examined, (found.within(TABLE) for found in mismatches))


@rule("BD-SPL-001")
def complete_groups_have_a_partition(view: ReleaseView) -> Iterator[Check]:
    """Every integrity-complete group has a partition and a cluster, and no other group has."""
    groups = view.frame("group_quality")
    yield _of_groups(num_rows(groups), membership_mismatches(groups))


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
    yield _of_groups(len(both), mismatches)


@rule("BD-SPL-003")
def clusters_lie_in_one_partition(view: ReleaseView) -> Iterator[Check]:
    """All groups of a route cluster are in one partition."""
    groups = view.frame("group_quality")
    yield _of_groups(len(set(clusters_of(groups).values())), cluster_mismatches(groups))


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
    if document["algorithm"] != ALGORITHM:
        raise PreconditionError(f"the split was drawn by {document['algorithm']!r}; only {ALGORITHM!r} recomputes")
    try:
        moved = list(draw_mismatches(groups, seed=int(document["seed"]), calibration=calibration_of(document)))
    except ValueError as error:
        raise PreconditionError(f"the split cannot be drawn again: {error}") from error
    yield _of_groups(len(assignment_of(groups)), moved)
