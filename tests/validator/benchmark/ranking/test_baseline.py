"""Baselines: what they are by hand and by another program, and what decides nothing."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from sklearn.linear_model import Ridge as SklearnRidge
from sklearn.neighbors import KNeighborsRegressor

from branchdrive.benchmark.protocol.selection import Neighbours, Prior
from branchdrive.benchmark.ranking.baseline import estimate, neighbour_means, prior_means, ridge_regression
from branchdrive.benchmark.ranking.context import Contexts, standardised, summaries
from branchdrive.benchmark.ranking.measure import choose

RNG = np.random.default_rng(5)
KNOWN, ASKED, UTILITIES = RNG.normal(size=(40, 7)), RNG.normal(size=(9, 7)), RNG.random((40, 3))


def test_prior_of_a_cell_is_shrunk_to_the_mean_of_all() -> None:
    utilities = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0], [0.0, 1.0]])  # mean of all 1/4, 1/2
    found = prior_means(["a", "a", "b", "b"], ["b", "a", "unseen"], utilities, strength=2.0)
    expected = [[(0 + 0.5) / 4, (2 + 1) / 4], [(1 + 0.5) / 4, (0 + 1) / 4], [0.25, 0.5]]
    np.testing.assert_allclose(found, expected)


def test_strong_prior_is_the_best_constant_and_a_weak_one_the_table() -> None:
    cells = [number % 4 for number in range(40)]
    strong = prior_means(cells, cells, UTILITIES, strength=1e6)
    np.testing.assert_allclose(strong, np.broadcast_to(UTILITIES.mean(axis=0), strong.shape), atol=1e-4)
    weak = prior_means(cells, [1], UTILITIES, strength=1e-3)
    np.testing.assert_allclose(weak[0], UTILITIES[1::4].mean(axis=0), atol=1e-3)


def test_neighbours_and_ridge_are_those_of_scikit_learn() -> None:
    other = KNeighborsRegressor(n_neighbors=6).fit(KNOWN, UTILITIES)
    np.testing.assert_allclose(neighbour_means(KNOWN, ASKED, UTILITIES, count=6), other.predict(ASKED))
    centred = KNOWN - KNOWN.mean(axis=0)
    ridge = SklearnRidge(alpha=0.3 * len(KNOWN)).fit(centred, UTILITIES)
    np.testing.assert_allclose(ridge_regression(centred, ASKED, UTILITIES, strength=0.3), ridge.predict(ASKED))


def test_groups_that_tie_with_the_last_neighbour_count_too() -> None:
    known = np.array([[0.0], [1.0], [-1.0], [1.0 + 1e-14], [5.0]])
    utilities = np.array([[0.0], [3.0], [6.0], [9.0], [99.0]])
    assert neighbour_means(known, np.zeros((1, 1)), utilities, count=2).tolist() == [[4.5]]
    assert neighbour_means(known, np.zeros((1, 1)), utilities, count=1).tolist() == [[0.0]]
    assert neighbour_means(known, np.zeros((1, 1)), utilities, count=50).tolist() == [[pytest.approx(117 / 5)]]


def _estimates(rows: NDArray[np.int64]) -> list[NDArray[np.float64]]:
    return [
        prior_means((rows % 5).tolist(), [0, 3, 9], UTILITIES[rows], strength=4.0),
        neighbour_means(KNOWN[rows], ASKED, UTILITIES[rows], count=5),
        ridge_regression(KNOWN[rows], ASKED, UTILITIES[rows], strength=0.5),
    ]


def test_order_of_training_groups_decides_nothing() -> None:
    for one, other in zip(_estimates(np.arange(40)), _estimates(RNG.permutation(40)), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-13)


def test_last_bits_choose_nothing() -> None:
    """Utilities, distances and cells of which many tie."""
    rng = np.random.default_rng(2)
    known, asked = rng.integers(0, 2, (60, 4)) * 1.0, rng.integers(0, 2, (20, 4)) * 1.0
    utilities = rng.integers(0, 3, (60, 5)) / 3

    def choices(*, noise: float) -> list[list[int]]:
        x, z, u = (values * (1 + noise * rng.normal(size=values.shape)) for values in (known, asked, utilities))
        found = (
            prior_means(known[:, 0].tolist(), asked[:, 0].tolist(), u, strength=3.0),
            neighbour_means(x, z, u, count=4),
            ridge_regression(x, z, u, strength=0.1),
        )
        return [choose(scores).tolist() for scores in found]

    expected = choices(noise=0.0)
    assert all(choices(noise=1e-15) == expected for _ in range(5))


def test_summary_takes_what_is_available() -> None:
    window = np.array([[[1.0, np.nan], [4.0, np.nan], [np.nan, np.nan]]])
    last, mean, least, greatest, share = np.split(summaries(window)[0], 5)
    assert (last[0], mean[0], least[0], greatest[0]) == (4.0, 2.5, 1.0, 4.0)
    assert np.isnan([last[1], mean[1], least[1], greatest[1]]).all()
    assert share.tolist() == [pytest.approx(2 / 3), 0.0]


def test_standardised_summary_is_zero_where_it_says_nothing() -> None:
    train = np.array([[1.0, 7.0, np.nan], [3.0, 7.0, np.nan], [np.nan, 7.0, np.nan]])
    found = standardised(train, np.array([[4.0, 9.0, 1.0], [np.nan, 7.0, np.nan], [1e300, 0.0, 0.0]]))
    assert found.tolist() == [[2.0, 0.0, 0.0], [0.0, 0.0, 0.0], [8.0, 0.0, 0.0]]


def test_overflow_makes_a_summary_say_nothing() -> None:
    huge = np.array([[[1.7e308], [1.7e308]], [[-1.7e308], [1.0]]])
    assert np.isfinite(standardised(summaries(huge), summaries(huge))).all()


def test_training_groups_without_a_utility_are_left_out() -> None:
    contexts = Contexts({"a": 0, "b": 1, "c": 2}, {"town": ["x", "x", "y"]}, {"privileged": None})
    prior = Prior(name="p", kind="prior", by=("town",), strength=1.0)
    utilities = np.array([[1.0, 0.0], [np.nan, 0.5]])
    np.testing.assert_allclose(estimate(prior, contexts, ["a", "b"], utilities, ["c", "b"]), [[1.0, 0.0]] * 2)
    with pytest.raises(ValueError, match="none of 2 groups has all its utilities"):
        estimate(prior, contexts, ["a", "b"], utilities * np.nan, ["c"])
    near = Neighbours(name="n", kind="neighbours", contract="privileged", neighbours=1)
    with pytest.raises(ValueError, match="no evidence of surroundings"):
        estimate(near, contexts, ["a", "b"], utilities, ["c"])
