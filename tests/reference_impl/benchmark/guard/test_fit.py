"""Fitted risk: against a second optimiser, calibrated, deterministic, and of use to the guard end to end."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from tests.validator.benchmark.guard.banks import banks

from branchdrive.benchmark.guard.calibration import ALPHA, conformal
from branchdrive.benchmark.guard.path import violations
from branchdrive.benchmark.guard.risk import FEATURES, RiskFit, guarded_path, risk, risk_features, standardised
from branchdrive.driving.target import Targets
from branchdrive.driving.utility import PROFILES, fit_scale, utility
from branchdrive.errors import UsageError

pytest.importorskip("cvxpy")
module = pytest.importorskip("branchdrive_reference.benchmark.guard.fit")

TRAIN = banks(250, seed=21)
SCALE = fit_scale(TRAIN.outcomes)
SIGNS = np.array([feature.sign for feature in FEATURES])


def fitted(outcomes: Targets = TRAIN.outcomes, scalars: np.ndarray = TRAIN.scalars, nominal: int = 0) -> RiskFit:
    found = module.fit_risk(scalars, outcomes, nominal=nominal, scale=SCALE)
    assert isinstance(found, RiskFit)
    return found


@pytest.fixture(scope="module")
def fit() -> RiskFit:
    return fitted()


def rows_of(fit: RiskFit) -> np.ndarray:
    features = risk_features(TRAIN.scalars, nominal=0, tolerance_m=fit.tolerance_m, spread_m=fit.spread_m)[:, 1:]
    return standardised(features.reshape(-1, len(FEATURES)), np.array(fit.centre), np.array(fit.spread))


def lost_m() -> np.ndarray:
    separation = TRAIN.outcomes.values[..., 1]
    return (separation[:, :1] - separation[:, 1:]).reshape(-1)


def test_features_are_standardised_on_training(fit: RiskFit) -> None:
    rows = rows_of(fit)
    np.testing.assert_allclose(rows.mean(axis=0), 0, atol=0.02)
    np.testing.assert_allclose(rows.std(axis=0), 1, atol=0.02)


def test_fits_are_optimal_by_a_second_optimiser(fit: RiskFit) -> None:
    rows, lost = rows_of(fit), lost_m()
    label, severity = (lost > 0.25).astype(float), np.clip(lost - 0.25, 0, 3)

    def logistic(w: np.ndarray) -> float:
        z = rows @ w[:-1] + w[-1]
        return float(np.mean(np.logaddexp(0, z) - label * z) + 2e-3 * (w[:-1] ** 2).sum())

    def huber(w: np.ndarray) -> float:
        e = np.abs(rows @ w[:-1] + w[-1] - severity)
        return float(np.mean(np.where(e <= 1, e**2, 2 * e - 1)) + 2e-3 * (w[:-1] ** 2).sum())

    bounds = [(None, 0) if sign < 0 else (0, None) if sign > 0 else (None, None) for sign in SIGNS] + [(None, None)]
    for loss, weights, offset in (
        (logistic, fit.logistic, fit.logistic_offset),
        (huber, fit.severity, fit.severity_offset),
    ):
        other = minimize(loss, np.zeros(len(FEATURES) + 1), method="L-BFGS-B", bounds=bounds)
        found = np.array([*weights, offset])
        assert loss(found) <= other.fun + 1e-6
        np.testing.assert_allclose(found, other.x, atol=5e-3)


def test_probabilities_are_calibrated_on_average(fit: RiskFit) -> None:
    # The offset bears no penalty, so the mean probability is the rate.
    z = rows_of(fit) @ np.array(fit.logistic) + fit.logistic_offset
    assert (1 / (1 + np.exp(-z))).mean() == pytest.approx((lost_m() > 0.25).mean(), abs=1e-4)


def test_risk_tells_violations_of_new_groups(fit: RiskFit) -> None:
    new = banks(400, seed=22)
    separation = new.outcomes.values[..., 1]
    lost = (separation[:, :1] - separation[:, 1:] > 0.25).reshape(-1)
    found = risk(fit, new.scalars, nominal=0)[:, 1:].reshape(-1)
    above = found[lost][:, None] > found[~lost][None, :500]
    assert above.mean() > 0.85


def test_directions_hold_and_the_document_is_complete(fit: RiskFit) -> None:
    assert (np.array(fit.logistic) * SIGNS >= 0).all()
    assert (np.array(fit.severity) * SIGNS >= 0).all()
    assert list(fit.grids) == list(PROFILES)
    assert all(grid.dual_multiplier > 0 for grid in fit.grids.values())
    assert RiskFit.model_validate_json(fit.model_dump_json()) == fit


def test_the_same_training_gives_the_same_fit(fit: RiskFit) -> None:
    assert fitted() == fit


def test_neither_the_solver_nor_the_last_bits_of_predictions_decide(
    fit: RiskFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("branchdrive_reference.benchmark.guard.program.SOLVERS", {})
    signs = np.random.default_rng(4).choice([-1.0, 1.0], TRAIN.scalars.shape)
    moved = fitted(scalars=TRAIN.scalars * (1 + 2e-16 * signs))
    for name in ("logistic", "logistic_offset", "severity", "severity_offset", "centre", "spread"):
        np.testing.assert_allclose(getattr(moved, name), getattr(fit, name), rtol=0, atol=1e-9)
    for name, grid in fit.grids.items():
        assert moved.grids[name].dual_multiplier == pytest.approx(grid.dual_multiplier, rel=1e-9)
        np.testing.assert_allclose(moved.grids[name].multipliers, grid.multipliers, rtol=1e-9)


def test_a_feature_that_varies_by_rounding_is_no_feature(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("branchdrive_reference.benchmark.guard.program.SOLVERS", {})
    far = TRAIN.scalars.copy()
    far[..., 2] = 2e6 / 3
    found = fitted(scalars=far)
    place = [feature.name for feature in FEATURES].index("nominal_displacement_m")
    assert found.spread[place] == 1.0
    assert abs(found.logistic[place]) < 1e-6


def test_groups_without_a_separation_have_no_part(fit: RiskFit) -> None:
    # Groups that lack a separation are added: nothing changes, however wrong the rest of them is.
    values = np.concatenate([TRAIN.outcomes.values, np.full((2, 13, 6), 1e3)])
    values[250, 5, 1] = values[251, 0, 1] = np.nan
    scalars = np.concatenate([TRAIN.scalars, np.full((3, 2, 13, 6), -1e3)], axis=1)
    assert fitted(Targets(values, np.isfinite(values)), scalars) == fit


def test_candidates_have_keys_not_places(fit: RiskFit) -> None:
    order = np.random.default_rng(3).permutation(13)
    values = TRAIN.outcomes.values[:, order]
    moved = fitted(Targets(values, np.isfinite(values)), TRAIN.scalars[:, :, order], int(np.flatnonzero(order == 0)[0]))
    np.testing.assert_allclose(moved.logistic, fit.logistic, atol=1e-4)
    np.testing.assert_allclose(moved.severity, fit.severity, atol=1e-4)


def test_the_guard_keeps_its_rate_and_a_part_of_the_gain(fit: RiskFit) -> None:
    new = banks(2400, seed=23)
    separation, clusters = new.outcomes.values[..., 1], np.array(new.clusters)
    path = guarded_path(fit, new.scalars, nominal=0, scale=SCALE, profile=PROFILES["balanced"], profile_name="balanced")
    losses = violations(path.selections, separation, nominal=0)
    utilities = utility(new.outcomes, SCALE, PROFILES["balanced"])
    gains = utilities[np.arange(2400), path.selections] - utilities[:, 0]
    rng = np.random.default_rng(0)
    rates, retained = [], []
    for _ in range(60):
        inside = np.isin(np.arange(2400) // 2, rng.permutation(1200)[:60])
        found = conformal(losses[:, inside], clusters[inside].tolist())
        assert found.refusal is None
        rates.append(losses[found.place, ~inside].mean())
        retained.append(gains[found.place, ~inside].sum() / gains[-1, ~inside].sum())
    assert losses[-1].mean() > 2 * ALPHA
    assert np.mean(rates) <= ALPHA + 3 * np.std(rates) / np.sqrt(len(rates))
    assert np.mean(retained) > 0.3


def test_training_without_both_kinds_is_refused() -> None:
    values = np.full((5, 13, 6), 9.0)
    calm = Targets(values, np.isfinite(values))
    with pytest.raises(UsageError, match=r"^0 of 60 interventions of 5 training groups lose more than 0\.25 m"):
        module.fit_risk(TRAIN.scalars[:, :5], calm, nominal=0, scale=SCALE)
    nothing = np.full((5, 13, 6), np.nan)
    with pytest.raises(UsageError, match=r"^0 of 0 interventions of 0 training groups"):
        module.fit_risk(TRAIN.scalars[:, :5], Targets(nothing, np.isfinite(nothing)), nominal=0, scale=SCALE)
    with pytest.raises(UsageError, match="do not match"):
        module.fit_risk(TRAIN.scalars, calm, nominal=0, scale=SCALE)
