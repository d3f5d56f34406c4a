"""Near duplicates: nearest neighbours against a plain search, and what is flagged across partitions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from branchdrive.model import near_duplicate
from branchdrive.model.near_duplicate import (
    Nearest,
    history_vectors,
    judged_distances,
    near_duplicates,
    nearest_in_training,
    nearest_other,
)


def oracle(points: list[list[float]], labels: list[int]) -> list[tuple[float, int]]:
    """Nearest point of another label, by a plain search."""
    found = []
    for a, label in zip(points, labels, strict=True):
        others = [(math.dist(a, b), row) for row, b in enumerate(points) if labels[row] != label]
        found.append(min(others, default=(math.inf, -1)))
    return found


@given(
    st.integers(1, 4).flatmap(
        lambda width: st.lists(
            st.tuples(st.lists(st.integers(-3, 3).map(float), min_size=width, max_size=width), st.integers(0, 3)),
            max_size=30,
        )
    )
)
def test_the_plain_search_agrees_where_many_are_equally_near(rows: list[tuple[list[float], int]]) -> None:
    points, labels = [list(point) for point, _ in rows], [label for _, label in rows]
    found = nearest_other(np.reshape(points, (len(points), -1)) if points else np.empty((0, 2)), labels)
    expected = oracle(points, labels)
    assert found.row.tolist() == [row for _, row in expected]
    np.testing.assert_allclose(found.distance, [distance for distance, _ in expected], rtol=1e-15)


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 40)), max_size=40), st.booleans())
def test_the_plain_search_agrees_where_most_points_are_equal(rows: list[tuple[int, int]], signed: bool) -> None:
    places = [[0.0, 0.0], [1.0, 0.0], [-0.0 if signed else 0.0, 0.0]]
    points, labels = [places[place] for place, _ in rows], [label for _, label in rows]
    found = nearest_other(np.reshape(points, (len(points), 2)), labels)
    expected = oracle(points, labels)
    assert found.row.tolist() == [row for _, row in expected]
    assert found.distance.tolist() == [distance for distance, _ in expected]


@pytest.mark.parametrize("size", [1, 7, 64])
def test_ranges_of_points_find_what_all_of_them_find(size: int) -> None:
    rng = np.random.default_rng(3)
    points, homes = rng.normal(size=(60, 5)), np.array(["train", "val", "test"])[rng.integers(0, 3, 60)]
    points[40:50] = points[:10]
    in_training, labels = homes == "train", np.unique(homes, return_inverse=True)[1]
    rows = [slice(start, start + size) for start in range(0, 60, size)]
    found = Nearest(*map(np.concatenate, zip(*(nearest_other(points, labels, each) for each in rows), strict=True)))
    own = np.concatenate([nearest_in_training(points, in_training, each) for each in rows])
    whole = near_duplicates(points, homes.tolist())
    parts = judged_distances(own, found)
    assert (parts.threshold, parts.flagged.tolist()) == (whole.threshold, whole.flagged.tolist())
    assert [column.tolist() for column in parts.nearest] == [column.tolist() for column in whole.nearest]


def test_equal_points_are_compared_with_few_of_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    compared = []
    distances = near_duplicate._distance

    def counted(points: Any, a: Any, b: Any) -> Any:
        compared.append(len(a))
        return distances(points, a, b)

    monkeypatch.setattr(near_duplicate, "_distance", counted)
    found = nearest_other(np.ones((500, 7)), np.arange(500))
    assert found.row.tolist() == [1, *[0] * 499]
    assert sum(compared) <= 2 * 500


@pytest.mark.parametrize("cells", [1, 100, 1 << 21])
def test_blocks_change_nothing(monkeypatch: pytest.MonkeyPatch, cells: int) -> None:
    rng = np.random.default_rng(0)
    points, labels = rng.normal(size=(60, 50)), rng.integers(0, 3, 60)
    monkeypatch.setattr(near_duplicate, "_MAX_CELLS", cells)
    found = nearest_other(points, labels)
    expected = oracle(points.tolist(), labels.tolist())
    assert found.row.tolist() == [row for _, row in expected]
    np.testing.assert_allclose(found.distance, [distance for distance, _ in expected], rtol=1e-12)


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e8])
def test_equal_points_far_from_the_origin_are_at_distance_zero(scale: float) -> None:
    rng = np.random.default_rng(1)
    points = 1e6 * scale + scale * rng.normal(size=(40, 576))
    points[30] = points[3]
    points[31] = points[4] + scale * 1e-3
    found = nearest_other(points, np.arange(40) // 20)
    assert found.distance[30] == found.distance[3] == 0
    assert (found.row[30], found.row[31]) == (3, 4)
    assert found.distance[31] == pytest.approx(scale * 1e-3 * math.sqrt(576), rel=1e-4)


def test_points_that_a_matrix_product_cannot_tell_apart_are_told_apart() -> None:
    points = 1e6 + 1e-3 * np.random.default_rng(2).normal(size=(40, 20))
    labels = np.arange(40) % 2
    expected = oracle(points.tolist(), labels.tolist())
    assert nearest_other(points, labels).row.tolist() == [row for _, row in expected]


def test_without_another_label_nothing_is_near() -> None:
    found = nearest_other(np.zeros((3, 2)), [4, 4, 4])
    assert found.distance.tolist() == [math.inf] * 3
    assert found.row.tolist() == [-1] * 3


def grid(num_train: int = 101) -> Any:
    """Training points on a line, one apart, but for one pair that is closer."""
    points = np.zeros((num_train, 3))
    points[:, 0] = np.arange(num_train)
    return points


def test_the_threshold_is_the_first_percentile_of_the_training_distances() -> None:
    train = grid()
    train[1, 0] = 0.2  # points 0 and 1 are 0.2 apart, all others at least 0.8
    found = near_duplicates(np.concatenate([train, [[0, 5, 0]]]), ["train"] * 101 + ["test"])
    assert found.threshold == pytest.approx(0.2)
    assert not found.flagged.any()
    assert found.num_examined == 102


@pytest.mark.parametrize(("apart", "flagged"), [(0.999, True), (1.0, False), (1.001, False), (0.0, True)])
def test_who_is_closer_than_the_threshold_is_flagged_with_its_neighbour(apart: float, flagged: bool) -> None:
    found = near_duplicates(np.concatenate([grid(), [[50, apart, 0]]]), ["train"] * 101 + ["val"])
    assert found.threshold == 1
    assert np.flatnonzero(found.flagged).tolist() == ([50, 101] if flagged else [])
    assert found.nearest.row[101] == 50
    assert found.nearest.distance[101] == apart


@pytest.mark.parametrize(
    ("apart", "doubtful"),
    [(1 - 3e-9, False), (1 - 1e-9, True), (1.0, True), (1 + 1e-9, True), (1 + 3e-9, False), (0.0, False)],
)
def test_last_bits_decide_close_to_the_threshold_alone(apart: float, doubtful: bool) -> None:
    found = near_duplicates(np.concatenate([grid(), [[50, apart, 0]]]), ["train"] * 101 + ["val"])
    assert found.threshold == 1
    assert found.doubtful[101] == doubtful


def test_equal_histories_are_never_in_doubt() -> None:
    found = near_duplicates(np.zeros((10, 4)), ["train"] * 9 + ["test"])
    assert found.flagged.all()
    assert not found.doubtful.any()


def test_partitions_other_than_training_are_compared_too() -> None:
    points = np.concatenate([grid(), [[0, 50, 0], [0, 50.5, 0]]])
    for homes, flagged in ((["val", "test"], [101, 102]), (["val", "val"], [])):
        found = near_duplicates(points, ["train"] * 101 + homes)
        assert np.flatnonzero(found.flagged).tolist() == flagged


def test_equal_histories_are_flagged_even_where_training_repeats_itself() -> None:
    points = np.zeros((10, 4))
    points[5:] = 1
    found = near_duplicates(points, ["train"] * 9 + ["test"])
    assert found.threshold == 0
    assert found.flagged.tolist() == [False] * 5 + [True] * 5


def test_training_alone_examines_nobody() -> None:
    found = near_duplicates(grid(5), ["train"] * 5)
    assert found.num_examined == 0
    assert not found.flagged.any()


@given(st.integers(0, 1000))
def test_order_and_names_of_partitions_change_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(40, 2))
    homes = np.array(["train"] * 20 + ["val"] * 10 + ["test"] * 10)
    order = rng.permutation(40)
    renamed = np.where(homes == "val", "a", homes)
    expected, found = near_duplicates(points, homes.tolist()), near_duplicates(points[order], renamed[order].tolist())
    assert found.threshold == expected.threshold
    assert (found.flagged == expected.flagged[order]).all()
    assert (order[found.nearest.row] == expected.nearest.row[order]).all()


def test_histories_become_one_vector_per_group() -> None:
    state, controls = np.arange(2 * 16 * 21).reshape(2, 16, 21), -np.arange(2 * 80 * 3).reshape(2, 80, 3)
    found = history_vectors(state, controls)
    assert found.shape == (2, 16 * 21 + 80 * 3)
    assert (found[1, : 16 * 21] == state[1].ravel()).all()
    assert (found[1, 16 * 21 :] == controls[1].ravel()).all()
    assert history_vectors(np.empty((0, 16, 21)), np.empty((0, 80, 3))).shape == (0, 576)


def test_wrong_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match="1 groups in training"):
        near_duplicates(np.zeros((2, 3)), ["train", "test"])
    with pytest.raises(ValueError, match=r"vectors of shape \[2, 3\] and 3 partitions"):
        near_duplicates(np.zeros((2, 3)), ["train"] * 3)
    with pytest.raises(ValueError, match="do not match"):
        nearest_other(np.zeros((2, 3)), [0])
    for value in (np.nan, np.inf, 1e101):
        with pytest.raises(ValueError, match=r"not a number or beyond 1e\+100"):
            nearest_other([[0.0, value]], [0])
    with pytest.raises(ValueError, match="histories of shapes"):
        history_vectors(np.zeros((2, 16, 21)), np.zeros((3, 80, 3)))


@pytest.mark.parametrize(("num_train", "flagged"), [(9, [10]), (10, [10, 11])])
def test_few_training_groups_have_no_threshold_and_only_equal_histories_count(
    num_train: int, flagged: list[int]
) -> None:
    others = [[0.0, 0.0, 0.0], [3.0, 0.5, 0.0]]  # equal to a training group, and closer than they are to each other
    found = near_duplicates(np.concatenate([grid(num_train), others]), ["train"] * num_train + ["val"] * 2)
    assert found.threshold == (1 if num_train >= 10 else 0)
    assert [row for row in np.flatnonzero(found.flagged).tolist() if row >= num_train] == [
        row - (10 - num_train) for row in flagged
    ]
