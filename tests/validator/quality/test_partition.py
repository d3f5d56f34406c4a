"""Partitions of a release: clusters by sorted group, a draw over integrity-complete groups, columns and document."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.validator.quality.release import concat, reaching, shuffled

from branchdrive.quality.partition import (
    PARTITIONS,
    assignment_of,
    calibration_of,
    cluster_of_groups,
    clusters_of,
    draw_assignment,
    split_document,
    with_assignment,
)
from branchdrive.statistics.split import Calibration, split_digest
from branchdrive.tables.frame import sort_rows, take


def straight(x_m: float, y_m: float = 0.0) -> Any:
    return np.stack([np.linspace(x_m, x_m + 100, 32), np.full(32, y_m)], axis=1)


def undrawn(num_complete: int = 40, num_lost: int = 5) -> dict[str, Any]:
    """Groups as they are before a split."""
    groups = concat([reaching("b", 4, num_complete), reaching("a", 2, num_lost)])
    return {name: groups[name] for name in ("group_id", "scenario_type", "integrity_complete")}


def in_clusters(groups: dict[str, Any], size: int = 2) -> dict[str, int]:
    complete = sorted(groups["group_id"][groups["integrity_complete"]].tolist())
    return {group_id: i // size for i, group_id in enumerate(complete)}


def test_clusters_are_numbered_in_order_of_the_sorted_groups() -> None:
    routes = [straight(50), straight(0), straight(50.5), straight(0.5)]
    assert cluster_of_groups(["d", "c", "a", "b"], ["T"] * 4, routes) == {"a": 0, "b": 1, "c": 1, "d": 0}


def test_routes_of_different_towns_share_no_cluster() -> None:
    assert cluster_of_groups(["a", "b"], ["T1", "T2"], [straight(0)] * 2) == {"a": 0, "b": 1}


def test_no_groups_have_no_clusters() -> None:
    assert cluster_of_groups([], [], np.zeros((0, 32, 2))) == {}


@given(st.permutations(range(6)))
def test_the_order_of_the_groups_decides_no_cluster(order: list[int]) -> None:
    ids, routes = [f"g{i}" for i in range(6)], [straight(i // 2 * 10.0) for i in range(6)]
    expected = {f"g{i}": i // 2 for i in range(6)}
    assert cluster_of_groups([ids[i] for i in order], ["T"] * 6, [routes[i] for i in order]) == expected


@pytest.mark.parametrize(
    ("group_ids", "towns", "message"),
    [(["a"], ["T", "T"], "1 groups, 2 towns and 1 routes"), (["a", "a"], ["T", "T"], "1 routes")],
)
def test_inputs_of_clusters_must_match(group_ids: list[str], towns: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        cluster_of_groups(group_ids, towns, [straight(0)])


def test_a_group_is_clustered_once() -> None:
    with pytest.raises(ValueError, match="given twice"):
        cluster_of_groups(["a", "a"], ["T", "T"], [straight(0)] * 2)


def test_integrity_complete_groups_and_no_others_are_drawn() -> None:
    groups = undrawn()
    clusters = in_clusters(groups)
    assignment = draw_assignment(groups, clusters, seed=1)
    assert list(assignment) == sorted(clusters)
    counts = [list(assignment.values()).count(name) for name in PARTITIONS]
    assert counts == [28, 6, 6, 0]


@settings(max_examples=20)
@given(st.integers(0, 2**32), st.integers(0, 2**32))
def test_the_order_of_the_rows_decides_nothing(seed: int, order: int) -> None:
    groups = undrawn()
    clusters = in_clusters(groups)
    assignment = draw_assignment(groups, clusters, seed=seed)
    assert draw_assignment(shuffled(groups, order), dict(reversed(clusters.items())), seed=seed) == assignment
    here = with_assignment(groups, clusters, assignment)
    there = with_assignment(shuffled(groups, order), clusters, assignment)
    for name, values in sort_rows(there, ["group_id"]).items():
        assert values.tolist() == sort_rows(here, ["group_id"])[name].tolist()


def test_a_calibration_partition_holds_what_was_asked() -> None:
    groups = undrawn()
    clusters = in_clusters(groups)
    least = Calibration(min_groups=9, min_clusters=3)
    assignment = draw_assignment(groups, clusters, seed=3, calibration=least)
    document = split_document(assignment, clusters, seed=3, calibration=least)
    assert document["partitions"]["calibration"]["groups"] >= 9
    assert document["calibration"] == {"min_groups": 9, "min_clusters": 3}
    assert calibration_of(document) == least


@pytest.mark.parametrize("num_clusters", [1, 2])
def test_a_partition_that_would_be_empty_is_refused(num_clusters: int) -> None:
    groups = undrawn(num_clusters, 0)
    with pytest.raises(ValueError, match=f"in {num_clusters} route clusters? leave no group to .*; a cluster"):
        draw_assignment(groups, in_clusters(groups, size=1), seed=0)


def test_no_integrity_complete_group_gives_no_split() -> None:
    with pytest.raises(ValueError, match="0 integrity-complete groups"):
        draw_assignment(undrawn(0, 3), {}, seed=0)


def test_every_integrity_complete_group_needs_a_cluster() -> None:
    groups = undrawn()
    clusters = in_clusters(groups)
    with pytest.raises(ValueError, match="'b-0000' has none"):
        draw_assignment(groups, {g: c for g, c in clusters.items() if g != "b-0000"}, seed=0)
    with pytest.raises(ValueError, match="'zzz' is none of them"):
        draw_assignment(groups, {**clusters, "zzz": 9}, seed=0)


def test_columns_are_masked_where_a_group_has_no_partition() -> None:
    groups = undrawn(3, 1)
    clusters = in_clusters(groups, size=1)
    assignment = {"b-0000": "train", "b-0001": "val", "b-0002": "test"}
    found = with_assignment(groups, clusters, assignment)
    assert found["partitioned"].tolist() == [True, True, True, False]
    assert found["route_cluster"].tolist() == [0, 1, 2, None]
    assert found["route_cluster"].dtype == np.int32
    assert found["partition"].tolist() == ["train", "val", "test", None]
    assert assignment_of(found) == assignment
    assert clusters_of(found) == clusters
    with pytest.raises(ValueError, match="a partition are not the same: 'b-0002' has none"):
        with_assignment(groups, clusters, {"b-0000": "train", "b-0001": "val"})


def test_the_document_counts_and_freezes_the_assignment() -> None:
    assignment = {"a": "train", "b": "train", "c": "val", "d": "test"}
    document = split_document(assignment, {"a": 0, "b": 0, "c": 1, "d": 2}, seed=11)
    assert document == {
        "algorithm": "clustered-1",
        "seed": 11,
        "shares": {"train": 70, "val": 15, "test": 15},
        "calibration": None,
        "num_clusters": 3,
        "partitions": {
            "train": {"groups": 2, "clusters": 1},
            "val": {"groups": 1, "clusters": 1},
            "test": {"groups": 1, "clusters": 1},
        },
        "digest": hashlib.sha256(b"a\ttrain\nb\ttrain\nc\tval\nd\ttest\n").hexdigest(),
    }
    assert document["digest"] == split_digest(assignment)


def test_stored_rows_give_back_what_was_drawn() -> None:
    groups = undrawn()
    clusters = in_clusters(groups)
    assignment = draw_assignment(groups, clusters, seed=5)
    stored = with_assignment(groups, clusters, assignment)
    assert split_document(assignment_of(stored), clusters_of(stored), seed=5) == split_document(
        assignment, clusters, seed=5
    )
    assert assignment_of(take(stored, ~stored["partitioned"])) == {}
