"""Sums are rounded once in whatever order they are added, and numbers that differ by rounding tie."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from branchdrive.statistics import rounding
from branchdrive.statistics.bca import intervals
from branchdrive.statistics.rounding import slack, sums
from branchdrive.statistics.sign_flip import sign_flip


@pytest.fixture
def values() -> np.ndarray:
    """Columns of one magnitude, of many, with an outlier, of nothing, and too small to be squared."""
    rng = np.random.default_rng(0)
    plain = rng.normal(size=300)
    outlier = np.where(np.arange(300) == 7, 1e12, plain)
    return np.stack([plain, plain * 10.0 ** rng.integers(-9, 9, 300), outlier, 0 * plain, plain * 1e-300], axis=1)


def test_a_sum_is_the_exact_one_rounded(values: np.ndarray) -> None:
    counts = np.random.default_rng(1).integers(0, 5, (4, 300)).astype(float)
    found = sums(counts, values)
    for row, count in enumerate(counts):
        for column in range(values.shape[1]):
            exact = sum(Fraction(value) * int(c) for value, c in zip(values[:, column], count, strict=True))
            assert found[row, column] == pytest.approx(float(exact), rel=1e-15, abs=0)


def test_a_sum_does_not_depend_on_the_order_of_its_terms(values: np.ndarray) -> None:
    rng = np.random.default_rng(2)
    counts = rng.integers(-3, 5, (4, 300)).astype(float)
    for _ in range(5):
        order = rng.permutation(300)
        assert (sums(counts[:, order], values[order]) == sums(counts, values)).all()


def test_a_sum_takes_whole_numbers_of_a_byte_a_part_at_a_time(
    values: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts = np.random.default_rng(3).integers(-3, 5, (7, 300))
    expected = sums(counts.astype(float), values)
    monkeypatch.setattr(rounding, "_MAX_CELLS", 2 * 300)
    np.testing.assert_array_equal(sums(counts.astype(np.int8), values), expected)


def test_numbers_tie_relative_to_what_they_come_from() -> None:
    assert slack([0.0, 1.0, -1e6]) == pytest.approx([1e-12, 1e-12 + 1e-9, 1e-12 + 1e-3])


def test_resamples_that_tie_with_the_estimate_count_half_whatever_their_last_bits() -> None:
    """Half of the resamples are the estimate but for last bits, a quarter lie on either side: no bias, ``z0 = 0``."""
    resamples = np.repeat([0.1, 0.3, 0.3, 0.5], 25)
    jackknife = np.array([[0.2], [0.4]])
    args = (jackknife, resamples[:, None], np.array([2]), np.array([2]))
    ends = []
    for noise in (0.0, 1e-16, -1e-16):
        shifted = resamples + noise * np.where(np.arange(100) % 3, 1.0, 0.0)
        found = intervals(np.array([0.1 + 0.2]), shifted[:, None], *args)
        ends.append([found.bca_low[0], found.bca_high[0], found.low[0], found.high[0]])
    assert ends == [pytest.approx(ends[0], abs=1e-12)] * 3
    assert ends[0][:2] == pytest.approx(ends[0][2:])


def test_a_jackknife_that_differs_by_rounding_has_no_acceleration() -> None:
    resamples = np.linspace(0.0, 1.0, 101)[:, None]
    args = (np.array([9]), np.array([9]))
    plain, rounded = (
        intervals(np.array([0.5]), resamples, jackknife, resamples, *args)
        for jackknife in (np.full((9, 1), 0.5), 0.5 + np.array([[0.0] * 8 + [1e-15]]).T)
    )
    assert (plain.bca_low, plain.bca_high) == (rounded.bca_low, rounded.bca_high)


def test_flips_that_reach_the_difference_but_for_rounding_reach_it() -> None:
    """``0.1 + 0.2 - 0.3`` is not 0, yet these three flips of large differences say the same."""
    differences = np.array([[0.1], [0.2], [0.3]]) * 1e6
    signs = np.array([[1.0, 1, -1], [-1, -1, 1], [1, -1, 1]])
    assert sign_flip(differences * np.array([[1.0], [1], [-1]]), signs).p == 1.0
