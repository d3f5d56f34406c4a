"""Outcomes and predictions: masks hide what is absent, and what is not a number is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.validator.statistics.samples import outcomes, predictions

from branchdrive.benchmark.prediction.metric.outcome import Outcomes, Predictions

VALUES = np.zeros((2, 3, 6))
HERE = np.ones((2, 3, 6), np.bool_)
PATHS = np.zeros((2, 3, 10, 5))


def test_a_path_with_a_missing_step_is_not_complete() -> None:
    values = PATHS.copy()
    values[1, 2, 4] = np.nan
    found = Outcomes.of(VALUES, HERE, values)
    assert np.argwhere(~found.complete).tolist() == [[1, 2]]
    assert np.isfinite(found.paths).all()


def test_taking_groups_keeps_their_order() -> None:
    truth = outcomes(4)
    order = np.array([2, 0])
    np.testing.assert_array_equal(truth.take(order).scalars, truth.scalars[order])
    np.testing.assert_array_equal(predictions(truth).take(order).paths, predictions(truth).paths[order])
    assert truth.take(order).num_groups == 2


@pytest.mark.parametrize(
    ("values", "available", "paths", "match"),
    [
        (VALUES[:1], HERE, PATHS, "do not match"),
        (VALUES, HERE[:1], PATHS, "a mask of shape"),
        (VALUES, HERE, PATHS[:, :, :9], "do not match"),
        (VALUES[:0], HERE[:0], PATHS[:0], "neither empty"),
        (VALUES + np.nan, HERE, PATHS, "an available outcome is nan"),
        (VALUES, HERE, PATHS + np.inf, "an available outcome is inf"),
    ],
)
def test_outcomes_that_do_not_fit_are_refused(values: Any, available: Any, paths: Any, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        Outcomes.of(values, available, paths)


@pytest.mark.parametrize(
    ("values", "paths", "match"),
    [
        (VALUES[..., :5], PATHS, "do not match"),
        (VALUES, PATHS[:, :2], "do not match"),
        (VALUES + np.nan, PATHS, "a prediction is nan"),
        (VALUES, PATHS - np.inf, "a prediction is -inf"),
        (VALUES + 1e13, PATHS, "a prediction is 1000.* not a finite number within"),
    ],
)
def test_predictions_that_do_not_fit_are_refused(values: Any, paths: Any, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        Predictions.of(values, paths)
