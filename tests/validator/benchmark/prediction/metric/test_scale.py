"""Scales against scipy, on the values that are there and no others."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import iqr
from tests.validator.statistics.samples import outcomes

from branchdrive.benchmark.prediction.metric.scale import target_scale
from branchdrive.driving.target import Targets
from branchdrive.model.normalisation import Training, fit_targets


def test_scales_are_those_of_scipy_on_available_values() -> None:
    truth = outcomes(20)
    found = target_scale(np.where(truth.available, truth.scalars, np.nan), truth.available)
    for t in range(6):
        values = truth.scalars[..., t][truth.available[..., t]]
        assert found.iqr[t] == pytest.approx(iqr(values))
        assert found.sd[t] == pytest.approx(values.std())


def test_the_iqr_is_the_scale_that_models_train_with() -> None:
    truth = outcomes(20)
    values = np.where(truth.available, truth.scalars, np.nan)
    fitted = fit_targets(Targets(values, truth.available), Training(np.ones(20, np.bool_), "digest"))
    np.testing.assert_array_equal(target_scale(values, truth.available).iqr, fitted.scale)


def test_a_constant_target_has_the_floor_and_an_absent_one_no_scale() -> None:
    available = np.ones((3, 4, 6), np.bool_)
    available[..., 2] = False
    found = target_scale(np.full((3, 4, 6), 5.0), available)
    np.testing.assert_array_equal(found.iqr, [1e-6, 1e-6, np.nan, 1e-6, 1e-6, 1e-6])
    np.testing.assert_array_equal(found.sd, found.iqr)


def test_the_order_of_groups_changes_no_bit() -> None:
    truth = outcomes(30, seed=4)
    turned = truth.take(np.arange(30)[::-1])
    for left, right in zip(
        target_scale(truth.scalars, truth.available), target_scale(turned.scalars, turned.available), strict=True
    ):
        np.testing.assert_array_equal(left, right)


@pytest.mark.parametrize(
    ("values", "available", "match"),
    [
        (np.zeros((2, 5)), np.ones((2, 5), np.bool_), "do not match"),
        (np.zeros((2, 6)), np.ones((3, 6), np.bool_), "do not match"),
        (np.full((2, 6), np.nan), np.ones((2, 6), np.bool_), "not finite"),
    ],
)
def test_training_values_that_do_not_fit_are_refused(values: Any, available: Any, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        target_scale(values, available)
