"""Ranks of many variables at once are those of each by itself."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest
from scipy.stats import spearmanr

from branchdrive.leakage import rank_correlation
from branchdrive.leakage.rank_correlation import centred_ranks, correlations, places_of


@pytest.mark.parametrize("at_once", [1, 50, 1 << 20])
def test_ranks_are_means_over_ties_about_their_mean(at_once: int) -> None:
    rng = np.random.default_rng(0)
    variables, weight = rng.integers(0, 6, (25, 7)).astype(float), rng.integers(0, 4, 25).astype(float)
    with patch.object(rank_correlation, "_RANKS_AT_ONCE", at_once):
        ranks, spreads = centred_ranks(places_of(variables), weight)
    for values, found, spread in zip(variables.T, ranks, spreads, strict=True):
        ordered = np.sort(np.repeat(values, weight.astype(int)))
        own = np.repeat(found, weight.astype(int))
        mean = {value: np.flatnonzero(ordered == value).mean() for value in set(ordered)}
        expected = np.array([mean[value] for value in np.repeat(values, weight.astype(int))])
        np.testing.assert_allclose(own, expected - expected.mean(), atol=1e-12)
        assert spread == pytest.approx(np.sqrt(np.square(expected - expected.mean()).sum()))


def test_no_variables_have_no_ranks() -> None:
    ranks, spreads = centred_ranks(places_of(np.zeros((4, 0))), np.ones(4))
    assert (ranks.shape, spreads.shape) == ((0, 4), (0,))


@pytest.mark.parametrize("exact", [1.0, 1e4, 2.0**53])
def test_correlations_of_many_are_those_of_each_over_the_groups_it_has(exact: float) -> None:
    rng = np.random.default_rng(1)
    variables, others = rng.integers(0, 8, (40, 6)).astype(float), rng.normal(size=(40, 5))
    there = np.arange(40) % 7 > 0
    ranks, spreads = centred_ranks(places_of(variables), there.astype(float))
    own, own_spreads = centred_ranks(places_of(others), np.tile(there, (5, 1)).astype(float))
    with patch.object(rank_correlation, "_EXACT", exact):
        found = correlations(ranks, spreads, own * there, own_spreads, int(there.sum()))
    expected = [[spearmanr(x[there], y[there]).statistic for x in variables.T] for y in others.T]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_constant_correlates_with_nothing() -> None:
    ranks, spreads = centred_ranks(places_of(np.ones((9, 1))), np.ones(9))
    assert correlations(ranks, spreads, ranks, spreads, 9).tolist() == [[0.0]]


def test_values_that_are_no_numbers_share_a_place() -> None:
    assert places_of(np.array([[np.nan], [2.0], [-np.inf], [np.nan]])).tolist() == [[2, 1, 0, 2]]
