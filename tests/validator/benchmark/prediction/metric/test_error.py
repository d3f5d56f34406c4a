"""Group errors against scikit-learn, loops and cases known by hand."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.metrics import mean_absolute_error
from tests.validator.statistics.samples import outcomes, perfect, predictions

from branchdrive.benchmark.prediction.metric.error import PATH_ERRORS, absolute_errors, group_errors
from branchdrive.benchmark.prediction.metric.outcome import Outcomes, Predictions


def straight(speed_mps: float = 4.0, yaw_rad: float = 0.0) -> np.ndarray:
    """A path ``[1, 1, 10, 5]`` along x with a fixed heading."""
    x = 0.25 * speed_mps * np.arange(1, 11)
    columns = [x, 0 * x, 0 * x + np.sin(yaw_rad), 0 * x + np.cos(yaw_rad), 0 * x + speed_mps]
    return np.stack(columns, axis=1)[None, None]


def path_errors(truth: np.ndarray, predicted: np.ndarray) -> dict[str, float]:
    scalars = np.zeros((1, 1, 6))
    recorded = Outcomes.of(scalars, scalars == 0, truth)
    return dict(zip(PATH_ERRORS, group_errors(recorded, Predictions.of(scalars, predicted)).path[0], strict=True))


def test_absolute_errors_are_those_of_scikit_learn() -> None:
    truth = outcomes(8)
    predicted = predictions(truth)
    found = group_errors(truth, predicted)
    for g in range(8):
        for t in range(6):
            mask = truth.available[g, :, t]
            expected = np.nan
            if mask.any():
                expected = mean_absolute_error(truth.scalars[g, mask, t], predicted.scalars[g, mask, t])
            np.testing.assert_allclose(found.absolute[g, t], expected)
            assert found.num_available[g, t] == mask.sum()


def test_a_path_that_is_faster_is_ahead() -> None:
    found = path_errors(straight(4.0), straight(6.0))
    assert found["speed_mae_mps"] == pytest.approx(2.0)
    assert found["fde_m"] == pytest.approx(5.0)
    assert found["ade_m"] == pytest.approx(0.5 * 5.5)
    assert found["heading_mae_deg"] == 0.0


@pytest.mark.parametrize(("true_deg", "predicted_deg", "expected"), [(0, 30, 30), (170, -170, 20), (-90, 90, 180)])
def test_headings_differ_the_short_way_round(true_deg: float, predicted_deg: float, expected: float) -> None:
    found = path_errors(straight(yaw_rad=np.deg2rad(true_deg)), straight(yaw_rad=np.deg2rad(predicted_deg)))
    assert found["heading_mae_deg"] == pytest.approx(expected)


def test_the_norm_of_a_predicted_heading_does_not_matter() -> None:
    predicted = straight(yaw_rad=0.5)
    predicted[..., 2:4] *= 3.0
    assert path_errors(straight(), predicted)["heading_mae_deg"] == pytest.approx(np.rad2deg(0.5))


def test_displacement_sideways_counts_as_ahead() -> None:
    predicted = straight()
    predicted[..., 0] += 3.0
    predicted[..., 1] -= 4.0
    found = path_errors(straight(), predicted)
    assert found["ade_m"] == found["fde_m"] == pytest.approx(5.0)


def test_perfect_predictions_have_no_error() -> None:
    truth = outcomes(gaps=0.5)
    found = group_errors(truth, perfect(truth))
    for values in (found.absolute, found.path, found.square):
        assert np.nanmax(values) == 0.0


def test_what_is_said_about_absent_outcomes_does_not_matter() -> None:
    truth = outcomes(gaps=0.5)
    predicted = predictions(truth)
    other = Predictions.of(np.where(truth.available, predicted.scalars, 1e6), predicted.paths)
    for left, right in zip(group_errors(truth, predicted), group_errors(truth, other), strict=True):
        np.testing.assert_array_equal(left, right)


def test_incomplete_paths_are_left_out() -> None:
    truth = outcomes(2, 3)
    complete = np.array([[True, False, True], [False, False, False]])
    masked = Outcomes(truth.scalars, truth.available, truth.paths, complete)
    predicted = predictions(truth)
    found = group_errors(masked, predicted).path
    kept = np.array([0, 2])
    alone = Outcomes(*(field[:1, kept] for field in (truth.scalars, truth.available, truth.paths, complete)))
    expected = group_errors(alone, Predictions.of(predicted.scalars[:1, kept], predicted.paths[:1, kept])).path
    np.testing.assert_allclose(found[0], expected[0])
    assert np.isnan(found[1]).all()


def test_absolute_errors_of_many_predictions_are_those_of_each() -> None:
    truth = outcomes(gaps=0.5)
    complete = np.arange(truth.complete.size).reshape(truth.complete.shape) % 3 > 0
    truth = Outcomes(truth.scalars, truth.available, truth.paths, complete)
    several = [predictions(truth), Predictions(truth.scalars + 1.0, 2.0 * truth.paths)]
    found = absolute_errors(
        truth, np.stack([each.scalars for each in several]), np.stack([each.paths[..., :2] for each in several])
    )
    for of_one, predicted in zip(found, several, strict=True):
        errors = group_errors(truth, predicted)
        np.testing.assert_array_equal(of_one, np.column_stack([errors.absolute, errors.path[:, 0]]))


def test_banks_of_another_size_are_refused() -> None:
    with pytest.raises(ValueError, match="do not match outcomes"):
        group_errors(outcomes(4, 5), predictions(outcomes(4, 6)))
