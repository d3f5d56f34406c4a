"""Folds: clusters stay whole, folds are even, and the order of groups decides nothing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive_reference.benchmark.guard.fold import cluster_folds

clusters = st.lists(st.integers(0, 30).map(str), min_size=20, max_size=80).filter(lambda names: len(set(names)) >= 5)


@given(clusters, st.integers(0, 5))
def test_a_cluster_is_in_one_fold_and_every_fold_has_one(names: list[str], seed: int) -> None:
    found = cluster_folds(names, seed=seed)
    assert len({(name, fold) for name, fold in zip(names, found.tolist(), strict=True)}) == len(set(names))
    assert set(found.tolist()) == set(range(5))


def test_folds_are_even_where_clusters_are_small() -> None:
    found = cluster_folds([str(place // 3) for place in range(300)], seed=1)
    assert np.bincount(found).tolist() == [60] * 5


@given(clusters, st.randoms(use_true_random=False))
def test_the_order_of_groups_does_not_matter(names: list[str], random: object) -> None:
    order = list(range(len(names)))
    random.shuffle(order)  # type: ignore[attr-defined]
    moved = cluster_folds([names[place] for place in order], seed=2)
    assert moved.tolist() == cluster_folds(names, seed=2)[order].tolist()


def test_the_seed_decides() -> None:
    names = [str(place) for place in range(40)]
    assert cluster_folds(names, seed=1).tolist() != cluster_folds(names, seed=2).tolist()


@pytest.mark.parametrize(("num_folds", "seed"), [(4, 0), (1, 0), (2, -1), (2, 1 << 64)])
def test_broken_arguments_are_refused(num_folds: int, seed: int) -> None:
    with pytest.raises(ValueError, match=r"cannot be parted|`seed` is"):
        cluster_folds(["a", "b", "c"], seed=seed, num_folds=num_folds)


def test_folds_are_those_of_the_stated_stream() -> None:
    # Drawn when the words came straight from numpy's Philox: released folds stay what they are.
    found = cluster_folds([f"r{place * 7 % 23}" for place in range(40)], seed=3)
    expected = "1222404331301014034224312224043313010140"
    assert "".join(map(str, found.tolist())) == expected
