"""Spearman correlations against scipy, with ties, gaps, and groups that count several times."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import ConstantInputWarning, spearmanr
from tests.validator.statistics import samples

from branchdrive.statistics import spearman
from branchdrive.statistics.bootstrap import design
from branchdrive.statistics.spearman import bank_spearman, pooled_spearman


def reference(x: np.ndarray, y: np.ndarray) -> float:
    if len(x) < 2:
        return np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConstantInputWarning)
        return float(spearmanr(x, y).statistic)


@given(st.integers(0, 200), st.booleans(), st.sampled_from([0.0, 0.3, 0.8]))
def test_within_banks_it_is_that_of_scipy(seed: int, ties: bool, gaps: float) -> None:
    truth = samples.outcomes(4, 6, seed=seed, ties=ties, gaps=gaps)
    predicted = samples.predictions(truth, seed=seed + 1, ties=ties).scalars
    found = bank_spearman(truth.scalars, predicted, truth.available)
    for g in range(4):
        for t in range(6):
            mask = truth.available[g, :, t]
            expected = reference(truth.scalars[g, mask, t], predicted[g, mask, t])
            np.testing.assert_allclose(found[g, t], expected, atol=1e-12)


@given(st.integers(0, 200), st.booleans(), st.sampled_from([0.0, 0.3, 0.9]))
def test_pooled_it_is_that_of_scipy_on_repeated_groups(seed: int, ties: bool, gaps: float) -> None:
    truth = samples.outcomes(5, 4, seed=seed, ties=ties, gaps=gaps)
    predicted = np.stack([samples.predictions(truth, seed=seed + i, ties=ties).scalars for i in (1, 2)])
    counts = design(samples.alone(5), seed=seed, num_resamples=4)[:]
    found = pooled_spearman(truth.scalars, predicted, truth.available, counts)
    for p in range(2):
        for r, row in enumerate(counts.astype(int)):
            rows = np.repeat(np.arange(5), row)
            for t in range(6):
                mask = truth.available[rows, :, t]
                expected = reference(truth.scalars[rows, :, t][mask], predicted[p, rows, :, t][mask])
                np.testing.assert_allclose(found[p, r, t], expected, atol=1e-12)


def test_chunks_change_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = samples.outcomes(ties=True)
    predicted = samples.predictions(truth).scalars[None]
    counts = design(samples.alone(9), seed=0, num_resamples=50)[:]
    whole = pooled_spearman(truth.scalars, predicted, truth.available, counts)
    monkeypatch.setattr(spearman, "_NUM_CELLS", 7 * 45)
    np.testing.assert_array_equal(pooled_spearman(truth.scalars, predicted, truth.available, counts), whole)


@given(st.permutations(range(7)), st.booleans())
def test_the_order_of_groups_changes_no_bit(order: list[int], ties: bool) -> None:
    truth = samples.outcomes(7, ties=ties)
    predicted = samples.predictions(truth, ties=ties).scalars[None]
    counts = design(samples.alone(7), seed=2, num_resamples=5)[:]
    np.testing.assert_array_equal(
        pooled_spearman(truth.scalars[order], predicted[:, order], truth.available[order], counts[:, order]),
        pooled_spearman(truth.scalars, predicted, truth.available, counts),
    )


def test_only_the_order_of_values_matters() -> None:
    truth = samples.outcomes(gaps=0.0)
    predicted = samples.predictions(truth).scalars
    counts = np.ones((1, 9))
    np.testing.assert_array_equal(
        pooled_spearman(truth.scalars, np.exp(predicted)[None], truth.available, counts),
        pooled_spearman(truth.scalars, predicted[None], truth.available, counts),
    )
    np.testing.assert_array_equal(
        bank_spearman(truth.scalars, -predicted, truth.available),
        -bank_spearman(truth.scalars, predicted, truth.available),
    )


def test_a_constant_side_has_no_correlation() -> None:
    truth = samples.outcomes(gaps=0.0)
    constant = np.ones_like(truth.scalars)
    assert np.isnan(bank_spearman(truth.scalars, constant, truth.available)).all()
    assert np.isnan(bank_spearman(constant, truth.scalars, truth.available)).all()
    assert np.isnan(pooled_spearman(truth.scalars, constant[None], truth.available, np.ones((2, 9)))).all()


def test_a_target_that_is_nowhere_available_has_no_correlation() -> None:
    truth = samples.outcomes()
    nowhere = np.zeros_like(truth.available)
    assert np.isnan(bank_spearman(truth.scalars, truth.scalars, nowhere)).all()
    assert np.isnan(pooled_spearman(truth.scalars, truth.scalars[None], nowhere, np.ones((1, 9)))).all()
