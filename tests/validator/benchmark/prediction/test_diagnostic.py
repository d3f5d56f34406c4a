"""Spread ratio: what compression does to it, and which groups count."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.validator.statistics.samples import outcomes, perfect, predictions

from branchdrive.benchmark.prediction.diagnostic import spread, spread_ratios
from branchdrive.benchmark.prediction.metric.outcome import Outcomes, Predictions


@given(st.floats(0, 3), st.floats(-5, 5))
def test_a_prediction_that_compresses_has_its_factor_as_ratio(factor: float, offset: float) -> None:
    truth = outcomes(gaps=0.3)
    found = spread(truth, Predictions.of(factor * truth.scalars + offset, truth.paths))
    assert found.sd_ratio == pytest.approx(factor, abs=1e-12)
    assert found.variance_ratio == pytest.approx(factor**2, abs=1e-12)


def test_ratios_are_of_standard_deviations_over_available_candidates() -> None:
    truth = outcomes(6, gaps=0.4)
    predicted = predictions(truth)
    found = spread_ratios(truth, predicted)
    for g in range(6):
        for t in range(6):
            mask = truth.available[g, :, t]
            if mask.sum() < 2:
                assert np.isnan(found[g, t])
            else:
                sds = [values[g, mask, t].std() for values in (predicted.scalars, truth.scalars)]
                assert found[g, t] == pytest.approx(sds[0] / sds[1])


def test_the_median_runs_over_groups_and_targets() -> None:
    truth = outcomes(3, gaps=0.0)
    factors = np.arange(18.0).reshape(3, 1, 6)
    found = spread(truth, Predictions.of(truth.scalars * factors, truth.paths))
    assert found == pytest.approx((8.5, (64 + 81) / 2, 18))


def test_a_constant_prediction_has_no_spread_at_all() -> None:
    truth = outcomes(gaps=0.0)
    found = spread(truth, Predictions.of(np.full_like(truth.scalars, 0.1), truth.paths))
    assert (found.sd_ratio, found.variance_ratio) == (0.0, 0.0)


def test_outcomes_that_do_not_vary_are_left_out() -> None:
    truth = outcomes(4, gaps=0.0)
    scalars = truth.scalars.copy()
    scalars[1], scalars[:, :, 3] = 2.0, 1.0
    flat = Outcomes(scalars, truth.available, truth.paths, truth.complete)
    assert spread(flat, perfect(flat)) == pytest.approx((1.0, 1.0, 15))
    nothing = Outcomes(np.ones_like(scalars), truth.available, truth.paths, truth.complete)
    found = spread(nothing, predictions(truth))
    assert found.num_ratios == 0
    assert np.isnan([found.sd_ratio, found.variance_ratio]).all()
