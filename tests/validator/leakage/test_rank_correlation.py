"""Ranks of many variables at once are those of each by itself."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest

from branchdrive.leakage import rank_correlation
from branchdrive.leakage.rank_correlation import centred_ranks, places_of


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
