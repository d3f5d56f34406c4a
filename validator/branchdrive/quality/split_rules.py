"""Split rules: partitions are disjoint, complete and frozen. Source: paper V-E; spec/11-fidelity.md#split."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from branchdrive.contract.comparison import Problem
from branchdrive.contract.mismatch import Check, Location, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.layers.compare import problems_found
from branchdrive.layers.view import ReleaseView
from branchdrive.quality.partition import ALGORITHM, assignment_of, calibration_of, cluster_of_groups, clusters_of
from branchdrive.quality.split_check import (
    calibration_problems,
    cluster_problems,
    count_problems,
    digest_problems,
    draw_problems,
    empty_problems,
    membership_problems,
)
from branchdrive.tables.frame import num_rows

SPLIT = "quality/split.json"
TABLE: Location = {"file": "quality/group_quality.parquet", "table": "group_quality"}


def _of_groups(examined: int, problems: Iterable[Problem]) -> Check:
    return Check.of(examined, (Mismatch({**TABLE, "group_id": p.place}, p.expected, p.found) for p in problems))


@rule("BD-SPL-001")
def complete_groups_have_a_partition(view: ReleaseView) -> Iterator[Check]:
    """Every integrity-complete group has a partition and a cluster, and no other group has."""
    groups = view.frame("group_quality")
    yield _of_groups(num_rows(groups), membership_problems(groups))


@rule("BD-SPL-002")
def clusters_recompute(view: ReleaseView) -> Iterator[Check]:
    """Route clusters by geometry, numbered in order of the sorted groups."""
    found, routes = clusters_of(view.frame("group_quality")), view.extract["routes"]
    expected = cluster_of_groups(routes["group_id"].tolist(), routes["town"].tolist(), routes["points"])
    both = sorted(expected.keys() & found.keys())
    apart = [g for g in both if expected[g] != found[g]]
    yield _of_groups(
        len(both), (Problem(g, f"route cluster {expected[g]}", f"route cluster {found[g]}") for g in apart)
    )


@rule("BD-SPL-003")
def clusters_lie_in_one_partition(view: ReleaseView) -> Iterator[Check]:
    """All groups of a route cluster are in one partition."""
    groups = view.frame("group_quality")
    yield _of_groups(len(set(clusters_of(groups).values())), cluster_problems(groups))


@rule("BD-SPL-004")
def split_digest_recomputes(view: ReleaseView) -> Iterator[Check]:
    """The digest is that of the stored assignment: a group that moved, or is in two partitions, changes it."""
    document, groups = view.document(SPLIT), view.frame("group_quality")
    yield problems_found(SPLIT, 1, digest_problems(document, groups))


@rule("BD-SPL-005")
def partitions_are_large_enough(view: ReleaseView) -> Iterator[Check]:
    """Training, validation and test have a group each, and calibration what was asked of it."""
    document, groups = view.document(SPLIT), view.frame("group_quality")
    yield problems_found(SPLIT, 4, [*empty_problems(groups), *calibration_problems(document, groups)])


@rule("BD-SPL-006")
def split_counts_recompute(view: ReleaseView) -> Iterator[Check]:
    """Counts of groups and clusters are those of the stored assignment."""
    document, groups = view.document(SPLIT), view.frame("group_quality")
    yield problems_found(SPLIT, 1 + 2 * len(document["partitions"]), count_problems(document, groups))


@rule("BD-SPL-008")
def split_is_the_drawn_one(view: ReleaseView) -> Iterator[Check]:
    """Drawing again from stored clusters and scenario types, by the stored seed, gives the stored partitions."""
    document, groups = view.document(SPLIT), view.frame("group_quality")
    if document["algorithm"] != ALGORITHM:
        raise PreconditionError(f"the split was drawn by {document['algorithm']!r}; only {ALGORITHM!r} recomputes")
    try:
        problems = draw_problems(groups, seed=int(document["seed"]), calibration=calibration_of(document))
    except ValueError as error:
        raise PreconditionError(f"the split cannot be drawn again: {error}") from error
    yield _of_groups(len(assignment_of(groups)), problems)
