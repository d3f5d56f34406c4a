"""What is wrong with a stored split: every concern finds its own lie and keeps silent about others."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.mismatch import pointers, rows
from tests.validator.quality.release import concat, numbered, paper_groups, reaching, shuffled

from branchdrive.contract.mismatch import Mismatch
from branchdrive.quality.partition import assignment_of, clusters_of, draw_assignment, split_document, with_assignment
from branchdrive.quality.rules.split import (
    calibration_mismatches,
    cluster_mismatches,
    count_mismatches,
    digest_mismatches,
    draw_mismatches,
    empty_mismatches,
    membership_mismatches,
)
from branchdrive.statistics.split import Calibration

Table = dict[str, Any]


def split_mismatches(document: Table, groups: Table) -> list[Mismatch]:
    """All that is wrong with a split, however it was drawn."""
    return [
        *membership_mismatches(groups),
        *cluster_mismatches(groups),
        *digest_mismatches(document, groups),
        *empty_mismatches(groups),
        *calibration_mismatches(document, groups),
        *count_mismatches(document, groups),
    ]


def stored(*, calibration: int = 0) -> tuple[Table, Table]:
    """Document and rows of a split: 4 train, 2 val, 2 test, and one group that is lost."""
    sizes = {"train": 4, "val": 2, "test": 2, "calibration": calibration}
    groups = numbered(concat([reaching(name, 4, count, name) for name, count in sizes.items()] + [reaching("a", 2, 1)]))
    least = Calibration(calibration, 1) if calibration else None
    return split_document(assignment_of(groups), clusters_of(groups), seed=0, calibration=least), groups


def edited(groups: Table, column: str, group_id: str, value: Any) -> Table:
    values = groups[column].copy()
    values[groups["group_id"] == group_id] = value
    return {**groups, column: values}


def refrozen(document: Table, groups: Table) -> Table:
    """The document that a careful liar writes: digest and counts of the rows as they are."""
    fresh = split_document(assignment_of(groups), clusters_of(groups), seed=0)
    return {**fresh, "calibration": document["calibration"]}


@pytest.mark.parametrize("calibration", [0, 3])
def test_a_good_split_has_no_mismatch(calibration: int) -> None:
    document, groups = stored(calibration=calibration)
    assert split_mismatches(document, groups) == []
    assert split_mismatches(document, shuffled(groups, 1)) == []


def test_the_split_of_the_papers_size_has_no_mismatch() -> None:
    groups = paper_groups()
    assert split_mismatches(split_document(assignment_of(groups), clusters_of(groups), seed=0), groups) == []


def test_a_group_without_partition_is_found() -> None:
    document, groups = stored()
    lied = edited(groups, "partition", "val-0001", np.ma.masked)
    assert rows(membership_mismatches(lied)) == [
        ("val-0001", "a partition of ['train', 'val', 'test', 'calibration']", "none")
    ]
    assert split_mismatches(refrozen(document, lied), lied) == list(membership_mismatches(lied))


def test_a_partition_of_a_group_that_is_not_integrity_complete_is_found() -> None:
    _, groups = stored()
    (found,) = membership_mismatches(edited(groups, "partition", "a-0000", "test"))
    assert rows([found]) == [("a-0000", "no partition: it is not integrity-complete", "'test'")]


def test_an_unknown_partition_is_found() -> None:
    _, groups = stored()
    (found,) = membership_mismatches(edited(groups, "partition", "val-0000", "holdout"))
    assert (found.location["group_id"], found.found) == ("val-0000", "'holdout'")


@pytest.mark.parametrize(
    ("column", "group_id", "value"),
    [("partitioned", "val-0000", False), ("partitioned", "a-0000", True), ("route_cluster", "a-0000", 3)],
)
def test_flags_and_clusters_agree_with_partitions(column: str, group_id: str, value: Any) -> None:
    _, groups = stored()
    (found,) = membership_mismatches(edited(groups, column, group_id, value))
    assert found.location["group_id"] == group_id


def test_a_cluster_in_two_partitions_is_found() -> None:
    document, groups = stored()
    lied = edited(groups, "route_cluster", "val-0000", clusters_of(groups)["train-0003"])
    (found,) = cluster_mismatches(lied)
    assert found.location["group_id"] == "train-0003"
    assert found.found == "train (train-0003), val (val-0000)"
    assert found in split_mismatches(refrozen(document, lied), lied)


def test_a_stale_digest_is_found_where_a_group_moved() -> None:
    document, groups = stored()
    moved = edited(groups, "partition", "train-0000", "val")
    (found,) = digest_mismatches(document, moved)
    assert (found.location["pointer"], found.found) == ("/digest", document["digest"])
    assert found.expected == refrozen(document, moved)["digest"]
    assert not list(digest_mismatches(refrozen(document, moved), moved))


@pytest.mark.parametrize("name", ["train", "val", "test"])
def test_an_empty_partition_is_found(name: str) -> None:
    document, groups = stored()
    other = "val" if name != "val" else "test"
    emptied = {**groups, "partition": np.ma.where(groups["partition"] == name, other, groups["partition"])}
    assert rows(empty_mismatches(emptied)) == [(f"/partitions/{name}", "at least 1 group", "0 groups")]
    assert split_mismatches(refrozen(document, emptied), emptied) == list(empty_mismatches(emptied))


def test_a_calibration_partition_below_its_minimum_is_found() -> None:
    document, groups = stored(calibration=3)
    short = {**document, "calibration": {"min_groups": 4, "min_clusters": 1}}
    assert rows(calibration_mismatches(short, groups)) == [
        ("/calibration", "at least 4 groups in 1 route clusters", "3 groups in 3 route clusters")
    ]
    few = {**document, "calibration": {"min_groups": 3, "min_clusters": 4}}
    assert pointers(calibration_mismatches(few, groups)) == ["/calibration"]
    assert not list(calibration_mismatches({**document, "calibration": {"min_groups": 3, "min_clusters": 3}}, groups))


def test_a_calibration_partition_that_nobody_asked_for_is_found() -> None:
    document, groups = stored(calibration=3)
    assert rows(calibration_mismatches({**document, "calibration": None}, groups)) == [
        ("/calibration", "no calibration partition", "3 groups in 3 route clusters")
    ]


COUNTS: dict[str, tuple[Callable[[Table], Table], str, str, str]] = {
    "clusters": (lambda d: {**d, "num_clusters": 9}, "/num_clusters", "8", "9"),
    "groups of a partition": (
        lambda d: {**d, "partitions": {**d["partitions"], "val": {"groups": 3, "clusters": 2}}},
        "/partitions/val/groups", "2", "3",
    ),
    "a partition without groups": (
        lambda d: {**d, "partitions": {**d["partitions"], "calibration": {"groups": 1, "clusters": 0}}},
        "/partitions/calibration/groups", "0", "1",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", COUNTS)
def test_counts_are_those_of_the_rows(case: str) -> None:
    document, groups = stored()
    edit, place, expected, found = COUNTS[case]
    assert rows(split_mismatches(edit(document), groups)) == [(place, expected, found)]


def test_a_partition_that_the_document_leaves_out_is_found() -> None:
    document, groups = stored()
    without = {**document, "partitions": {k: v for k, v in document["partitions"].items() if k != "test"}}
    assert rows(count_mismatches(without, groups)) == [
        ("/partitions/test/groups", "2", "nothing"),
        ("/partitions/test/clusters", "2", "nothing"),
    ]


def test_the_drawn_split_is_the_drawn_one_and_any_other_is_told_group_by_group() -> None:
    groups = paper_groups()
    drawn = draw_assignment(groups, clusters_of(groups), seed=5)
    kept = with_assignment(groups, clusters_of(groups), drawn)
    assert not list(draw_mismatches(kept, seed=5))
    assert not list(draw_mismatches(shuffled(kept, 1), seed=5))
    moved = min(group_id for group_id, name in drawn.items() if name == "val")
    assert rows(draw_mismatches(edited(kept, "partition", moved, "train"), seed=5)) == [
        (moved, "partition val", "partition train")
    ]
    assert list(draw_mismatches(kept, seed=6))
    assert list(draw_mismatches(kept, seed=5, calibration=Calibration(20, 5)))
    with pytest.raises(ValueError, match="has none"):
        list(draw_mismatches(edited(kept, "route_cluster", moved, np.ma.masked), seed=5))
