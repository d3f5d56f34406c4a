"""The four statistics together: size, chunks, memory, and what renaming and shuffling must not change."""

from __future__ import annotations

import pickle
import tracemalloc
from itertools import chain
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import kstest
from tests.validator.leakage.samples import exchangeable

from branchdrive.leakage.draw import ranges_of
from branchdrive.leakage.gate_statistics import GateStatistics, chunk_length
from branchdrive.leakage.protocol import STATISTICS, GateProtocol
from branchdrive.leakage.scan import Layout
from branchdrive.statistics.permutation import labels, p_value
from branchdrive.statistics.random_words import group_orders

SMALL = GateProtocol(num_frequencies=16)
FIXED = GateProtocol(num_frequencies=16, bandwidth=3.0)
SCRATCH = 2**24
TOGETHER = Layout((0, 0, 0), (0, 1, 2))
"""Three features that are times of one command."""


def p_values(x: NDArray[np.float64], num_permutations: int, seed: int) -> list[float]:
    statistics = GateStatistics.of(x, SMALL, seed=seed)
    null = statistics.null(num_permutations, seed=seed, scratch_bytes=SCRATCH)
    return [p_value(value, column) for value, column in zip(statistics.observed(), null.T, strict=True)]


def test_p_is_uniform_where_nothing_leaks() -> None:
    found, untied = [], []
    for seed in range(400):
        statistics = GateStatistics.of(exchangeable(20, 5, 3, seed=seed), SMALL, seed=seed, layout=TOGETHER)
        observed, null = statistics.observed(), statistics.null(99, seed=seed, scratch_bytes=SCRATCH)
        found.append([p_value(value, column) for value, column in zip(observed, null.T, strict=True)])
        # Ranks tie often; a random share of the ties makes p continuous and exactly uniform.
        beyond = (null > observed + 1e-9 * np.abs(observed)).sum(axis=0)
        ties = 100 * np.array(found[-1]) - beyond
        untied.append((beyond + np.random.default_rng(seed).random(6) * ties) / 100)
    for column in np.array(untied).T:
        assert kstest(column, "uniform").pvalue > 0.001
    for column in np.array(found).T:
        for level in (0.05, 0.1, 0.2):
            assert np.mean(column <= level) < level + 3 * np.sqrt(level * (1 - level) / 400)


def test_p_is_not_too_small_with_ties_and_gaps() -> None:
    found = []
    for seed in range(200):
        x = np.round(exchangeable(20, 4, 3, seed=seed))
        x[np.random.default_rng(seed).random(x.shape) < 0.2] = np.nan
        found.append(p_values(x, 99, seed))
    assert (np.mean(np.array(found) <= 0.1, axis=0) < 0.1 + 3 * np.sqrt(0.09 / 200)).all()


@pytest.mark.parametrize("scratch_bytes", [1, 100_000, 1_000_000, 2**30])
def test_chunks_change_nothing(scratch_bytes: int) -> None:
    statistics = GateStatistics.of(exchangeable(23, 5, 4, seed=0), SMALL, seed=1)
    one_by_one, found = (statistics.null(60, seed=3, scratch_bytes=size) for size in (SCRATCH, scratch_bytes))
    np.testing.assert_allclose(found, one_by_one, rtol=1e-12)
    np.testing.assert_array_equal(found[:, :2], one_by_one[:, :2])


def test_what_statistics_share_is_what_each_computes_by_itself() -> None:
    x = exchangeable(30, 4, 3, seed=2)
    statistics = GateStatistics.of(x, SMALL, seed=0, layout=TOGETHER)
    null = statistics.null(20, seed=5, scratch_bytes=SCRATCH)
    rows = group_orders(5, "leakage/permutations", 20, 30, 4)
    matrix = labels(rows)
    for name in ("rank_max_t", "max_t", "hsic", "ridge"):
        assert getattr(statistics, name)(matrix).tolist() == null[:, STATISTICS.index(name)].tolist()
    parts = [(selection, part) for selection in statistics.concordance.selections for part in selection.parts]
    assert parts
    for selection, part in parts:
        own = rows[:, selection.groups[: part.num_groups]]
        assert part.sums(own).reshape(80, -1).tolist() == (labels(own) @ part.steps).tolist()


def test_a_seed_decides_everything() -> None:
    x = exchangeable(23, 5, 4, seed=0)
    of = Layout((0, 1, 2, 3), (0, 1, 2, 3))
    first, again, other = (
        GateStatistics.of(x, SMALL, seed=s, layout=of).null(20, seed=s, scratch_bytes=SCRATCH) for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.isclose(first, other).all(axis=0).any()


def test_renaming_actions_changes_no_statistic() -> None:
    x = exchangeable(23, 5, 4, seed=4)
    x[:, 1, 2] += 1.0
    renamed = x[:, [3, 0, 4, 2, 1]]
    found, expected = (GateStatistics.of(values, FIXED, seed=1).observed() for values in (renamed, x))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_shuffling_groups_changes_no_statistic() -> None:
    x = exchangeable(25, 5, 4, seed=5)
    expected = GateStatistics.of(x, FIXED, seed=1).observed()
    shuffled = x[np.random.default_rng(0).permutation(25)]
    np.testing.assert_allclose(GateStatistics.of(shuffled, FIXED, seed=1).observed()[:3], expected[:3], rtol=1e-9)
    within_folds = x.reshape(5, 5, 5, 4)[:, ::-1].reshape(x.shape)
    np.testing.assert_allclose(GateStatistics.of(within_folds, FIXED, seed=1).observed(), expected, rtol=1e-9)


def test_units_and_offsets_of_groups_change_no_statistic() -> None:
    x = np.round(exchangeable(25, 5, 3, seed=6) * 1024)
    moved = x * [2.0, 64.0, 0.25] + np.arange(25.0)[:, None, None] * 4096
    found, expected = (GateStatistics.of(values, FIXED, seed=1).observed() for values in (moved, x))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_the_yardstick_of_other_data_stays() -> None:
    x = exchangeable(25, 5, 3, seed=7)
    statistics = GateStatistics.of(x, SMALL, seed=1)
    np.testing.assert_array_equal(GateStatistics.like(statistics.reference, x, SMALL).observed(), statistics.observed())
    moved = x.copy()
    moved[:, 2, 1] += 3 * statistics.reference.sd[1]
    found = GateStatistics.like(statistics.reference, moved, SMALL)
    assert found.table.columns == statistics.table.columns
    np.testing.assert_array_equal(found.table.sd, statistics.table.sd)
    assert (found.observed()[:2] > statistics.observed()[:2]).all()


@pytest.mark.parametrize("num_features", [24, 400])
def test_a_chunk_fits_its_scratch_space(num_features: int) -> None:
    protocol = GateProtocol()
    columns = (4 + protocol.num_folds) * 2 * num_features
    length = chunk_length(606, 12, columns, protocol.scratch_bytes)
    held = length * (12 * 606 * 12 * 4 + 12 * columns * 8)
    assert length >= 40
    assert protocol.scratch_bytes // 2 < held < protocol.scratch_bytes
    assert chunk_length(606, 12, columns, 1) == 1


def test_memory_is_bounded_in_permutations() -> None:
    statistics = GateStatistics.of(exchangeable(200, 12, 30, seed=0), SMALL, seed=0)
    scratch_bytes = 8 * 2**20
    widest = max(getattr(statistics, name).scratch_columns for name in STATISTICS)
    assert chunk_length(200, 12, widest, scratch_bytes) > 10
    tracemalloc.start()
    try:
        statistics.null(300, seed=0, scratch_bytes=scratch_bytes)
        assert tracemalloc.get_traced_memory()[1] < scratch_bytes + 2**20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("count", "unit"), [(0, 3), (1, 3), (64, 1), (65, 1), (9_999, 37), (1_000_000, 400)])
def test_ranges_are_of_whole_units_and_hold_every_number_once(count: int, unit: int) -> None:
    ranges = ranges_of(count, unit)
    assert [*chain(*ranges)] == [*range(count)]
    assert len(ranges) <= 64
    assert all(each.start % unit == 0 for each in ranges)


def test_who_draws_a_range_decides_no_bit() -> None:
    statistics = GateStatistics.of(exchangeable(12, 4, 3, seed=2), SMALL, seed=1)
    drawn: list[int] = []

    def elsewhere(function: Any, subject: Any, ranges: Any) -> Any:
        drawn.extend(map(len, ranges))
        copies = {
            place: function(pickle.loads(pickle.dumps(subject)), ranges[place]) for place in range(len(ranges))[::-1]
        }
        return [copies[place] for place in range(len(ranges))]

    for start in (0, 7):
        here = statistics.null(200, seed=3, scratch_bytes=20_000, start=start)
        there = statistics.null(200, seed=3, scratch_bytes=20_000, start=start, draw=elsewhere)
        assert here.tobytes() == there.tobytes()
    assert len(drawn) > 4
