"""Columns: standardisation, unavailability, ranks, exact sums, and rows that agree."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy.stats import rankdata
from tests.each import each
from tests.validator.leakage.samples import exchangeable

from branchdrive.leakage.table import MAX_GROUPS, Column, Table, rows_agree, step_limit, tabulate, within_group_rank
from branchdrive.statistics.permutation import labels
from branchdrive.statistics.random_words import group_orders

Array = NDArray[np.float64]
ANY = st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -0.0, 1.0, 2.0, -3.5, 1e308, -1e308, 5e-324, 1e-300])


def column(table: Table, feature: int, kind: str) -> Array:
    return table.values[:, :, table.columns.index((feature, kind))]


def test_values_are_distances_from_the_group_median_in_robust_standard_deviations() -> None:
    x = np.array([[1.0, 2, 4], [11, 10, 12]])[:, :, None]
    table = tabulate(x)
    assert table.sd == pytest.approx(1.4826 * 1.0)
    np.testing.assert_allclose(column(table, 0, "value"), np.array([[-1, 0, 2], [0, -1, 1]]) / 1.4826, atol=1e-6)
    np.testing.assert_allclose(column(table, 0, "deviation"), np.array([[1, 0, 2], [0, 1, 1]]) / 1.4826, atol=1e-6)


def test_a_feature_that_rarely_deviates_is_measured_by_its_root_mean_square() -> None:
    x = np.zeros((10, 4, 1))
    x[0, 0] = 3.0
    assert tabulate(x).sd == pytest.approx(3 / np.sqrt(40))


def test_values_are_clipped() -> None:
    x = exchangeable(20, 4, 1, seed=0)
    x[3, 2] = 1e6
    assert column(tabulate(x), 0, "value").max() == pytest.approx(6.0, rel=1e-5)


def test_unavailable_takes_the_group_median_and_has_a_column_of_its_own() -> None:
    x = np.array([[1.0, np.nan, 4, 3], [0, 1, 2, 3]])[:, :, None]
    table = tabulate(x)
    assert [kind for _, kind in table.columns] == ["value", "deviation", "unavailable"]
    assert column(table, 0, "value")[0, 1] == 0
    np.testing.assert_allclose(column(table, 0, "unavailable"), [[0, 1, 0, 0], [0, 0, 0, 0]], atol=1e-5)


def test_filling_in_does_not_move_the_median_of_the_others() -> None:
    x = exchangeable(6, 5, 2, seed=1)
    with_gaps = np.concatenate([x, np.full((6, 3, 2), np.nan)], axis=1)
    found, expected = tabulate(with_gaps), tabulate(x)
    np.testing.assert_array_equal(found.sd, expected.sd)
    np.testing.assert_array_equal(found.values[:, :5, :4], expected.values)


def test_a_feature_that_is_unavailable_in_whole_groups_alone_tells_nothing() -> None:
    x = exchangeable(6, 3, 1, seed=2)
    x[1] = np.nan
    table = tabulate(x)
    assert [kind for _, kind in table.columns] == ["value", "deviation"]
    assert not table.values[1].any()


def test_infinite_is_further_than_all_others() -> None:
    x = exchangeable(6, 4, 1, seed=3)
    x[2, 1], x[3, 1] = np.inf, -np.inf
    table = tabulate(x)
    assert column(table, 0, "value")[2:4, 1] == pytest.approx([6, -6], rel=1e-5)
    assert np.isfinite(table.sd).all()


def test_columns_that_are_constant_within_groups_are_left_out() -> None:
    x = np.concatenate([np.arange(5.0)[:, None, None] * np.ones((5, 3, 1)), exchangeable(5, 3, 1, seed=4)], axis=2)
    assert tabulate(x).columns == (Column(1, "value"), Column(1, "deviation"))


def test_two_rows_deviate_alike() -> None:
    assert tabulate(exchangeable(5, 2, 1, seed=5)).columns[0] == Column(0, "value")
    x = np.tile([[0.0], [2.0]], (5, 1, 1))
    assert tabulate(x).columns == (Column(0, "value"),)


@given(hnp.arrays(np.float64, hnp.array_shapes(min_dims=3, max_dims=3, min_side=2, max_side=5), elements=ANY))
def test_no_number_breaks_it(x: Array) -> None:
    table = tabulate(x)
    assert np.isfinite(table.steps).all()
    assert np.isfinite(table.ranks).all()
    assert np.isfinite(table.sd).all()
    assert np.abs(table.values).max(initial=0.0) <= 6.0
    differs = (x != x[:, :1]) & ~(np.isnan(x) & np.isnan(x[:, :1]))
    assert {found.feature for found in table.columns} == set(np.flatnonzero(differs.any(axis=(0, 1))).tolist())


def test_rows_of_a_group_are_treated_alike() -> None:
    x = exchangeable(8, 5, 3, seed=6)
    x[x > 2] = np.nan
    rows = group_orders(0, "leakage/permutations", 1, 8, 5)[0]
    moved, still = tabulate(np.take_along_axis(x, rows[:, :, None], axis=1)), tabulate(x)
    np.testing.assert_array_equal(moved.sd, still.sd)
    np.testing.assert_array_equal(moved.values, np.take_along_axis(still.values, rows[:, :, None], axis=1))


@given(hnp.arrays(np.int64, (3, 7, 2), elements=st.integers(-3, 3)))
def test_ranks_are_centred_doubled_averages_of_ties(values: NDArray[np.int64]) -> None:
    expected = 2 * rankdata(values, axis=1) - (values.shape[1] + 1)
    np.testing.assert_array_equal(within_group_rank(values), expected)


def test_sums_over_groups_are_exact() -> None:
    table = tabulate(exchangeable(500, 6, 4, seed=7))
    rows = labels(group_orders(1, "leakage/permutations", 4, 500, 6))
    for steps in (table.steps, table.ranks):
        expected = rows.astype(np.int64) @ steps.astype(np.int64)
        np.testing.assert_array_equal((rows @ steps).astype(np.int64), expected)


@pytest.mark.parametrize("num_groups", [1, 606, MAX_GROUPS])
def test_the_largest_sum_is_a_number_that_float32_holds(num_groups: int) -> None:
    assert 255 <= step_limit(num_groups) < 2**24
    assert step_limit(num_groups) * num_groups < 2**24


@pytest.mark.parametrize("shape", [(3, 4), (3, 1, 2), (3, 0, 2), (MAX_GROUPS + 1, 2, 1)])
def test_wrong_shapes_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="features have"):
        tabulate(np.zeros(shape))


@pytest.mark.parametrize("num_actions", [4, 5])
def test_the_middle_two_deviate_alike_in_every_bit(num_actions: int) -> None:
    x = exchangeable(40, num_actions, 3, seed=0)
    table = tabulate(x)
    place = [column.kind for column in table.columns].index("deviation")
    ranks = table.ranks.reshape(40, num_actions, -1)[:, :, place : place + 3]
    middle = np.argsort(x, axis=1)[:, [(num_actions - 1) // 2, num_actions // 2]]
    first, second = np.moveaxis(np.take_along_axis(ranks, middle, axis=1), 1, 0)
    np.testing.assert_array_equal(first, second)


def test_infinities_on_both_sides_of_the_middle_are_further_than_all_others() -> None:
    x = np.array([[[-np.inf], [-1.0], [1.0], [np.inf]], [[-np.inf], [-np.inf], [np.inf], [np.inf]]])
    values = column(tabulate(x), 0, "value")
    assert np.isfinite(values).all()
    assert values[:, 0] == pytest.approx([-6, -6], rel=1e-5)
    assert values[:, 3] == pytest.approx([6, 6], rel=1e-5)


def test_scores_that_differ_between_groups_alone_agree() -> None:
    scores = np.broadcast_to(np.random.default_rng(0).normal(size=(5, 1, 13)), (5, 13, 13))
    assert rows_agree(scores)


def test_one_row_of_one_group_disagrees() -> None:
    scores = np.zeros((5, 13, 13))
    scores[3, 12, 0] = 5e-324
    assert not rows_agree(scores)


def test_rounding_is_forgiven_on_request() -> None:
    scores = np.zeros((5, 13, 13))
    scores[3, 12, 0] = 1e-7
    assert not rows_agree(scores)
    assert rows_agree(scores, atol=1e-6)


@each(
    ("rows", "expected"),
    [
        ([np.nan, np.nan], True),
        ([np.nan, 0.0], False),
        ([0.0, np.nan], False),
        ([np.inf, np.inf], True),
        ([np.inf, 1.0], False),
        ([np.inf, np.nan], False),
        ([0.0, -0.0], True),
        ([1e308, -1e308], False),
    ],
)
def test_unavailable_agrees_with_unavailable_alone(rows: list[float], expected: bool) -> None:
    assert rows_agree([rows]) is expected


def test_values_need_rows() -> None:
    with pytest.raises(ValueError, match=r"shape \[3\], not \[groups, rows"):
        rows_agree([1.0, 2.0, 3.0])
