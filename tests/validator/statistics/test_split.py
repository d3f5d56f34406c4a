"""Splits: disjoint, within their bounds, independent of order and labels, and drawn as the text says."""

from __future__ import annotations

import hashlib
import random
from collections import Counter, defaultdict
from collections.abc import Hashable, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each

from branchdrive.statistics.bca import LEAST_UNITS
from branchdrive.statistics.random_words import orders, words
from branchdrive.statistics.split import (
    CALIBRATION,
    DIVIDED,
    SHARES,
    STRATIFIED,
    Calibration,
    assign_split,
    split_digest,
)


class Groups(NamedTuple):
    """Ids, cluster labels and scenario types of groups."""

    ids: list[str]
    clusters: list[Hashable]
    types: list[Hashable]


def groups(sizes: Sequence[int], num_types: int = 3, seed: int = 0) -> Groups:
    """Groups in clusters of the given sizes, of random types, in random order."""
    rng = random.Random(seed)
    clusters = [cluster for cluster, size in enumerate(sizes) for _ in range(size)]
    rows = [(f"g-{row:04}", cluster, rng.randrange(num_types)) for row, cluster in enumerate(clusters)]
    rng.shuffle(rows)
    return Groups(*map(list, zip(*rows, strict=True))) if rows else Groups([], [], [])


def sizes_of(assignment: dict[str, str]) -> Counter[str]:
    return Counter(assignment.values())


def is_disjoint(these: Groups, assignment: dict[str, str]) -> bool:
    """Whether all groups of a cluster are in one partition."""
    homes = {(cluster, assignment[group_id]) for group_id, cluster in zip(these.ids, these.clusters, strict=True)}
    return len(homes) == len(set(these.clusters))


def oracle(these: Groups, seed: int) -> dict[str, str]:
    """The three steps without calibration, as they read."""
    clusters: dict[Any, list[str]] = defaultdict(list)
    for group_id, cluster in zip(these.ids, these.clusters, strict=True):
        clusters[cluster].append(group_id)
    type_of = dict(zip(these.ids, these.types, strict=True))

    def key(members: list[str]) -> str:
        return hashlib.sha256(
            (f"{seed}\n" + "".join(f"{group_id}\n" for group_id in sorted(members))).encode()
        ).hexdigest()

    share = {"train": Fraction(70, 100), "val": Fraction(15, 100), "test": Fraction(15, 100)}
    held: dict[str, list[str]] = {name: [] for name in share}
    for members in sorted(clusters.values(), key=key):
        room = {name: share[name] * len(these.ids) - len(held[name]) for name in share}
        roomy = [name for name in share if room[name] >= len(members)]
        if not roomy:
            roomy = [name for name in share if room[name] == max(room.values())][:1]
        rarity = {}
        for name in roomy:
            same = sum(type_of[a] == type_of[b] for a in members for b in held[name])
            rarity[name] = (same / share[name], len(held[name]) / share[name])
        held[min(roomy, key=lambda name: rarity[name])] += members
    return {group_id: name for name, members in held.items() for group_id in members}


SIZES = st.lists(st.integers(1, 12), min_size=1, max_size=40)


@given(SIZES, st.integers(1, 6), st.integers(0, 2**70))
def test_the_plain_definition_agrees(sizes: list[int], num_types: int, seed: int) -> None:
    these = groups(sizes, num_types)
    assert assign_split(*these, seed=seed) == oracle(these, seed)


@each("seed", range(10))
def test_a_cluster_that_fills_a_partition_to_the_brim_fits(seed: int) -> None:
    these = groups([2, 1] * 20, num_types=4, seed=seed)  # 60 groups: 42, 9 and 9
    assert assign_split(*these, seed=seed) == oracle(these, seed)


@given(SIZES, st.integers(1, 6), st.integers(0, 1000))
def test_no_cluster_lies_in_two_partitions_and_shares_stay_in_their_bounds(
    sizes: list[int], num_types: int, seed: int
) -> None:
    these = groups(sizes, num_types)
    assignment = assign_split(*these, seed=seed)
    assert sorted(assignment) == sorted(these.ids)
    assert is_disjoint(these, assignment)
    found = sizes_of(assignment)
    for name, share in SHARES.items():
        excess = found[name] - share * len(these.ids) / 100
        assert -4 / 3 * max(sizes) - 1e-9 <= excess <= 2 / 3 * max(sizes) + 1e-9


@given(SIZES, st.integers(0, 1000), st.sampled_from([None, STRATIFIED, DIVIDED]))
def test_order_labels_and_type_names_decide_nothing(sizes: list[int], seed: int, calibrated: str | None) -> None:
    these = groups([*(min(size, 2) for size in sizes), *[1] * 9] if calibrated else sizes, seed=seed)
    calibration, algorithm = (Calibration(2, 1) if calibrated else None), calibrated or STRATIFIED
    expected = assign_split(*these, seed=7, calibration=calibration, algorithm=algorithm)
    rows = list(zip(*these, strict=True))
    random.Random(seed).shuffle(rows)
    ids, clusters, types = zip(*rows, strict=True)
    renamed = (
        [("cluster", -int(str(cluster))) for cluster in clusters],
        [f"type {9 - int(str(kind))}" for kind in types],
    )
    found = assign_split(ids, *renamed, seed=7, calibration=calibration, algorithm=algorithm)
    assert found == expected
    assert list(found) == sorted(found)


def test_the_seed_draws_anew() -> None:
    these = groups([1] * 60)
    found = {split_digest(assign_split(*these, seed=seed)) for seed in range(10)}
    assert len(found) == 10


def test_single_groups_meet_the_shares_to_the_group() -> None:
    found = sizes_of(assign_split(*groups([1] * 634, 10), seed=1))
    assert found == {"train": 444, "val": 95, "test": 95}


def test_every_scenario_type_is_spread_by_the_shares() -> None:
    these = groups([1 + row % 3 for row in range(300)], num_types=6, seed=3)
    assignment = assign_split(*these, seed=5)
    type_of = dict(zip(these.ids, these.types, strict=True))
    found = Counter((type_of[group_id], name) for group_id, name in assignment.items())
    for kind, num_groups in Counter(these.types).items():
        for name, share in SHARES.items():
            assert found[kind, name] / num_groups == pytest.approx(share / 100, abs=0.05)


def test_partitions_hold_clusters_of_all_sizes() -> None:
    these = groups([1, 2, 3, 10] * 40, num_types=4)
    mean_size = {}
    for name in SHARES:
        counts = []
        for seed in range(8):
            assignment = assign_split(*these, seed=seed)
            held = [
                cluster
                for group_id, cluster in zip(these.ids, these.clusters, strict=True)
                if assignment[group_id] == name
            ]
            counts.append(len(held) / len(set(held)))
        mean_size[name] = sum(counts) / len(counts)
    assert all(3 < size < 5.5 for size in mean_size.values())  # 4 on average


def test_a_cluster_larger_than_a_partition_stays_whole() -> None:
    these = groups([30, *[1] * 70])
    for seed in range(20):
        assignment = assign_split(*these, seed=seed)
        large = {
            assignment[group_id] for group_id, cluster in zip(these.ids, these.clusters, strict=True) if cluster == 0
        }
        assert len(large) == 1
        assert is_disjoint(these, assignment)


def test_one_cluster_leaves_the_others_empty() -> None:
    these = groups([5])
    assignment = assign_split(*these, seed=0)
    assert set(assignment.values()) == {"train"}


def test_no_groups_make_an_empty_split() -> None:
    assert assign_split([], [], [], seed=0) == {}


@given(
    st.lists(st.integers(1, 8), min_size=12, max_size=50), st.integers(0, 30), st.integers(0, 10), st.integers(0, 99)
)
def test_a_calibration_partition_holds_at_least_what_it_must(
    sizes: list[int], min_groups: int, min_clusters: int, seed: int
) -> None:
    these = groups(sizes)
    calibration = Calibration(min_groups, min_clusters)
    if min_groups > len(these.ids) // 2:
        return
    assignment = assign_split(*these, seed=seed, calibration=calibration, algorithm=STRATIFIED)
    assert sorted(assignment) == sorted(these.ids)
    assert is_disjoint(these, assignment)
    assert sizes_of(assignment)[CALIBRATION] >= max(1, min_groups)
    cluster_of = dict(zip(these.ids, these.clusters, strict=True))
    drawn = {cluster_of[group_id] for group_id, name in assignment.items() if name == CALIBRATION}
    assert len(drawn) >= min_clusters


@pytest.mark.parametrize("least", [Calibration(96, 1), Calibration(1, 48)])
def test_calibration_is_stratified_and_the_rest_keeps_its_shares(least: Calibration) -> None:
    these = groups([1 + row % 4 for row in range(300)], num_types=5, seed=2)
    assignment = assign_split(*these, seed=4, calibration=least, algorithm=STRATIFIED)
    found = sizes_of(assignment)
    assert 96 <= found[CALIBRATION] <= 140
    rest = len(these.ids) - found[CALIBRATION]
    for name, share in SHARES.items():
        assert found[name] / rest == pytest.approx(share / 100, abs=0.01)
    type_of = dict(zip(these.ids, these.types, strict=True))
    held = Counter(type_of[group_id] for group_id, name in assignment.items() if name == CALIBRATION)
    for kind, num_groups in Counter(these.types).items():
        assert held[kind] / num_groups == pytest.approx(found[CALIBRATION] / len(these.ids), abs=0.02)


def test_too_few_groups_or_clusters_for_calibration_are_refused() -> None:
    these = groups([2, 2, 2])
    for least in (Calibration(5, 1), Calibration(1, 3), Calibration(100, 1)):
        with pytest.raises(ValueError, match="6 groups in 3 clusters leave no cluster beside a calibration partition"):
            assign_split(*these, seed=0, calibration=least)
    with pytest.raises(ValueError, match="0 groups in 0 clusters"):
        assign_split([], [], [], seed=0, calibration=Calibration(1, 1))


GOOD = {"a": "train", "b": "train", "c": "val", "d": "test"}


def test_the_digest_is_that_of_sorted_lines() -> None:
    expected = hashlib.sha256(b"a\ttrain\nb\ttrain\nc\tval\nd\ttest\n").hexdigest()
    assert split_digest(GOOD) == split_digest(dict(reversed(GOOD.items()))) == expected
    assert split_digest({**GOOD, "d": "val"}) != expected


@pytest.mark.parametrize("group_id", ["a", "", "b c", "b\t", "\n"])
def test_an_id_that_is_given_twice_or_holds_white_space_is_refused(group_id: str) -> None:
    with pytest.raises(ValueError, match="is given twice, empty or holds white space"):
        assign_split(["a", group_id], [0, 1], [0, 0], seed=0)


def test_inputs_must_match() -> None:
    with pytest.raises(ValueError, match="1 clusters do not match 2 groups"):
        assign_split(["a", "b"], [0], [0, 0], seed=0)
    with pytest.raises(ValueError, match="3 scenario types do not match 2 groups"):
        assign_split(["a", "b"], [0, 1], [0, 0, 0], seed=0)


MIXED = groups([1 + row % 4 for row in range(160)], num_types=5, seed=2)
CLUSTER_OF = dict(zip(MIXED.ids, MIXED.clusters, strict=True))


def clusters_in(assignment: dict[str, str], *names: str) -> set[Hashable]:
    return {CLUSTER_OF[group_id] for group_id, name in assignment.items() if name in names}


LEAST = Calibration(88, 48)


def divided(seed: int, least: Calibration = LEAST) -> dict[str, str]:
    return assign_split(*MIXED, seed=seed, calibration=least)


def test_calibration_and_test_are_a_permutation_of_one_pool() -> None:
    """The clusters of the pool by their first group, in the order of one row of words: the first calibrate."""
    assignment = divided(4)
    first = {cluster: min(g for g in MIXED.ids if CLUSTER_OF[g] == cluster) for cluster in set(MIXED.clusters)}
    pool = sorted(clusters_in(assignment, CALIBRATION, "test"), key=first.__getitem__)
    order = orders(words(4, "split/calibration", 1, len(pool)))[0].tolist()
    drawn = clusters_in(assignment, CALIBRATION)
    assert {pool[place] for place in order[: len(drawn)]} == drawn
    assert is_disjoint(MIXED, assignment)


def test_a_calibration_cluster_is_one_of_the_pool_like_any_other() -> None:
    """Over seeds large and small clusters of the pool calibrate equally often; strata and sizes decide nothing."""
    share: dict[int, list[float]] = defaultdict(list)
    size_of = Counter(CLUSTER_OF.values())
    for seed in range(40):
        assignment = divided(seed)
        drawn = clusters_in(assignment, CALIBRATION)
        pool = clusters_in(assignment, CALIBRATION, "test")
        for cluster in pool:
            share[size_of[cluster]].append((cluster in drawn) - len(drawn) / len(pool))
    for found in share.values():
        assert abs(sum(found) / len(found)) < 4 * 0.5 / len(found) ** 0.5


def test_a_divided_pool_holds_what_was_asked_and_the_rest_keeps_its_shares() -> None:
    assignment = divided(7)
    found = sizes_of(assignment)
    assert found[CALIBRATION] >= 88
    assert len(clusters_in(assignment, CALIBRATION)) >= 48
    rest = len(MIXED.ids) - found[CALIBRATION]
    for name, share in SHARES.items():
        assert found[name] / rest == pytest.approx(share / 100, abs=0.06)


def test_how_many_clusters_calibrate_does_not_hang_on_the_draw() -> None:
    for least in (Calibration(88, 1), Calibration(1, 48)):
        sizes = {seed: len(clusters_in(divided(seed, least), CALIBRATION)) for seed in range(5)}
        assert all(abs(size - sizes[0]) <= 3 for size in sizes.values())  # pools differ, their divisions do not
    singles = groups([1] * 200)
    assert sizes_of(assign_split(*singles, seed=3, calibration=Calibration(88, 48)))[CALIBRATION] == 88


def test_without_calibration_the_algorithms_are_the_same() -> None:
    assert assign_split(*MIXED, seed=3, algorithm=STRATIFIED) == assign_split(*MIXED, seed=3, algorithm=DIVIDED)


@pytest.mark.parametrize(("num_groups", "num_partitions"), [(4, 2), (5, 3), (6, 3), (7, 3)])
def test_five_groups_on_different_routes_are_the_fewest_that_fill_every_partition(
    num_groups: int, num_partitions: int
) -> None:
    for seed in range(5):
        assignment = assign_split(
            [f"g{i}" for i in range(num_groups)], range(num_groups), ["a"] * num_groups, seed=seed
        )
        assert len({*assignment.values()}) == num_partitions


def test_forty_groups_on_different_routes_are_enough_where_replay_fidelity_takes_none() -> None:
    for seed in range(5):
        assignment = assign_split([f"g{i}" for i in range(40)], range(40), ["a"] * 40, seed=seed)
        assert [*assignment.values()].count("test") == LEAST_UNITS
