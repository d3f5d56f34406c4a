"""Regressions: the certificate bounds the distance, Newton steps reach the minimum from anywhere, oracles agree."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from branchdrive_reference.benchmark.guard.regression import HUBER, LOGISTIC, Loss, Regression, polished

LOSSES = {"logistic": LOGISTIC, "huber": HUBER}


def example(loss: Loss, seed: int, *, num_rows: int = 300, num_features: int = 6, penalty: float = 2e-3) -> Regression:
    """Rows with two equal features, weights of either sign, and truths that they explain in part."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(num_rows, num_features))
    rows[:, 1] = rows[:, 0]
    value = rows @ rng.normal(size=num_features) + rng.logistic(size=num_rows)
    truth = (value > 1.0).astype(float) if loss is LOGISTIC else np.clip(value, 0.0, 3.0)
    return Regression(rows, truth, loss, signs=rng.integers(-1, 2, num_features).astype(float), penalty=penalty)


@pytest.mark.parametrize("loss", LOSSES.values(), ids=LOSSES)
def test_slopes_curvatures_and_bounds_are_those_of_the_loss(loss: Loss) -> None:
    z, h = np.linspace(-6.0, 6.0, 241) + 0.0123, 1e-5  # off the kinks
    for y in (np.zeros_like(z), np.ones_like(z)):
        slope, curvature = loss.slope(z, y), loss.curvature(z, y)
        np.testing.assert_allclose(slope, (loss.value(z + h, y) - loss.value(z - h, y)) / (2 * h), atol=1e-8)
        np.testing.assert_allclose(curvature, (loss.slope(z + h, y) - loss.slope(z - h, y)) / (2 * h), atol=1e-8)
        for reach in (1e-3, 0.5):
            around = [loss.curvature(z + step, y) for step in np.linspace(-reach, reach, 21)]
            assert (loss.floor(z, y, reach) <= np.min(around, axis=0) + 1e-15).all()
        for step in (-3.0, -0.1, 0.7, 5.0):
            above = loss.value(z, y) + slope * step + 0.5 * loss.majorant(z, y) * step**2
            assert (above >= loss.value(z + step, y) - 1e-12).all()


def test_no_value_overflows() -> None:
    z = np.array([-1e4, -800.0, 800.0, 1e4])
    assert LOGISTIC.value(z, np.zeros(4)).tolist() == [0.0, 0.0, 800.0, 1e4]
    assert LOGISTIC.slope(z, np.zeros(4)).tolist() == [0.0, 0.0, 1.0, 1.0]
    assert LOGISTIC.curvature(z, np.zeros(4)).tolist() == [0.0] * 4


def test_minima_that_are_known() -> None:
    # No feature says anything: the offset is the logit of the rate, and the mean inside Huber's kinks.
    nothing, signs = np.zeros((8, 1)), np.zeros(1)
    rate = Regression(nothing, np.array([1.0, 1, 0, 0, 0, 0, 0, 0]), LOGISTIC, signs=signs, penalty=1e-3)
    assert polished(rate, np.zeros(2)) == pytest.approx([0.0, np.log(1 / 3)], abs=1e-12)
    mean = Regression(nothing, np.linspace(0.0, 1.0, 8), HUBER, signs=signs, penalty=1e-3)
    assert polished(mean, np.zeros(2)) == pytest.approx([0.0, 0.5], abs=1e-12)
    # From 0 every row lies beyond the kinks, where the loss has no curvature.
    far = Regression(nothing, np.linspace(2.0, 3.0, 8), HUBER, signs=signs, penalty=1e-3)
    assert polished(far, np.zeros(2)) == pytest.approx([0.0, 2.5], abs=1e-12)
    # Least squares with a ridge: w = sum x y / (sum x^2 + n r); a weight of the other sign is exactly 0.
    x = np.array([-1.0, 1.0])
    for sign, weight in ((0.0, 0.5 / 1.1), (1.0, 0.5 / 1.1), (-1.0, 0.0)):
        line = Regression(x[:, None], 0.5 * x, HUBER, signs=np.array([sign]), penalty=0.1)
        assert polished(line, np.zeros(2)) == pytest.approx([weight, 0.0], abs=1e-12)


@pytest.mark.parametrize("loss", LOSSES.values(), ids=LOSSES)
def test_every_start_leads_to_the_same_point(loss: Loss) -> None:
    rng = np.random.default_rng(1)
    for seed in range(6):
        program = example(loss, seed)
        first = polished(program, np.zeros(7))
        assert program.certificate(first).distance <= 1e-11
        starts = [first + 0.3 * rng.normal(size=7), first + 1e-7, rng.normal(size=7), 1e3 * rng.normal(size=7)]
        for start in starts:
            assert abs(polished(program, start) - first).max() <= 1e-11


@pytest.mark.parametrize("loss", LOSSES.values(), ids=LOSSES)
def test_a_certificate_bounds_the_true_distance_and_refuses_what_is_beside_the_minimum(loss: Loss) -> None:
    for seed in range(6):
        program = example(loss, seed)
        best = polished(program, np.zeros(7))
        free = np.flatnonzero((best != 0) | (program.signs == 0))
        for place in range(7):
            for moved_by in (1e-8, -1e-8, 1e-9, 3e-10):
                moved = best.copy()
                moved[place] += moved_by
                found = program.certificate(moved)
                assert found.distance >= abs(moved_by) - 1e-12
                if place in free:
                    assert found.distance < np.inf
        held = np.flatnonzero(program.signs != 0)
        wrong = best.copy()
        wrong[held[0]] = -1e-12 * program.signs[held[0]]
        assert program.certificate(wrong).distance == np.inf
        assert program.certificate(np.full(7, np.nan)).distance == np.inf
        assert program.certificate(np.zeros(7)).distance > 1e-3


def test_a_fit_that_leaves_its_offset_open_is_not_certified() -> None:
    # Two rows at 0 and two at 3: every offset from 1 to 2 costs the same.
    program = Regression(np.zeros((4, 1)), np.array([0.0, 0, 3, 3]), HUBER, signs=np.zeros(1), penalty=1e-3)
    found = program.certificate(polished(program, np.zeros(2)))
    assert (found.residual, found.curvature, found.distance) == (0.0, 0.0, np.inf)


def test_scipy_finds_the_same_minimum() -> None:
    for loss in LOSSES.values():
        program = example(loss, 11)
        bounds = [(None, 0) if sign < 0 else (0, None) if sign > 0 else (None, None) for sign in program.signs]
        other = minimize(
            program.value,
            np.zeros(7),
            jac=program.gradient,
            method="L-BFGS-B",
            bounds=bounds,
            options={"ftol": 1e-15, "gtol": 1e-10, "maxiter": 5000},
        )
        found = polished(program, np.zeros(7))
        assert program.value(found) <= other.fun + 1e-14
        np.testing.assert_allclose(found, other.x, atol=1e-5)


def test_scikit_learn_finds_the_same_minimum_without_signs() -> None:
    linear = pytest.importorskip("sklearn.linear_model")
    program = example(LOGISTIC, 12)
    program.signs[:] = 0.0
    # It minimises sum loss + |w|^2 / (2 C).
    other = linear.LogisticRegression(C=1 / (2 * program.penalty * len(program.rows)), tol=1e-12, max_iter=10_000)
    other.fit(program.rows[:, :-1], program.truth)
    np.testing.assert_allclose(polished(program, np.zeros(7)), [*other.coef_[0], *other.intercept_], atol=1e-5)


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    num_rows=st.sampled_from([12, 60, 400]),
    num_features=st.integers(1, 16),
    steepness=st.sampled_from([0.1, 1.0, 100.0]),
    noise=st.sampled_from([0.0, 1.0]),
    margin=st.sampled_from([0.0, 2.0]),
    decades=st.sampled_from([0, 6]),
)
def test_any_training_is_solved_with_a_certificate(
    seed: int, num_rows: int, num_features: int, steepness: float, noise: float, margin: float, decades: int
) -> None:
    """Separable, rare and collinear ones too; features of any scale are standardised and clipped as in `fit_risk`."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_t(2, size=(num_rows, num_features))
    rows[:, num_features // 2] = rows[:, 0] + (seed % 2) * 1e-9 * rows[:, num_features // 2]
    spread = rows.std(axis=0)
    value = steepness * (rows / spread) @ rng.normal(size=num_features) + noise * rng.logistic(size=num_rows) - margin
    rows *= 10.0 ** rng.uniform(-decades, decades, num_features)
    rows = np.clip((rows - rows.mean(axis=0)) / rows.std(axis=0), -8.0, 8.0)
    signs = rng.integers(-1, 2, num_features).astype(float)
    label, severity = (value > 0).astype(float), np.clip(value, 0.0, 3.0)
    label[0], label[1] = 0.0, 1.0
    severity[2:6] = [0.1, 0.4, 0.5, 0.9]
    for loss, truth in ((LOGISTIC, label), (HUBER, severity)):
        program = Regression(rows, truth, loss, signs=signs, penalty=2e-3)
        point = polished(program, np.zeros(num_features + 1))
        assert (point[:-1] * signs >= 0).all()
        assert program.certificate(point).distance <= 1e-10


def test_rows_that_are_no_numbers_are_refused() -> None:
    good = np.ones((2, 1))
    for rows, truth in ((good[:0], np.ones(0)), (good * np.nan, np.ones(2)), (good, np.array([1.0, np.inf]))):
        with pytest.raises(ValueError, match="finite numbers"):
            Regression(rows, truth, LOGISTIC, signs=np.zeros(1), penalty=1e-3)
