"""The fitted risk as a document: what it computes, what it refuses, and that it only falls with separation."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from tests.each import each
from tests.validator.benchmark.guard.banks import banks

from branchdrive.benchmark.guard.path import multiplier_grid
from branchdrive.benchmark.guard.risk import FEATURES, MultiplierGrid, RiskFit, guarded_path, risk
from branchdrive.driving.utility import PROFILES, fit_scale, predicted_utility

K = len(FEATURES)
FOUND = banks(25, seed=6)
SCALE = fit_scale(FOUND.outcomes)


def document(**changes: Any) -> dict[str, Any]:
    rng = np.random.default_rng(0)
    signs = np.array([feature.sign for feature in FEATURES])
    weights = np.where(signs == 0, rng.normal(size=K), signs * rng.random(K)) / 4
    return {
        "features": [feature.name for feature in FEATURES],
        "tolerance_m": 0.25,
        "spread_m": 0.4,
        "centre": [0.0] * K,
        "spread": [2.0] * K,
        "logistic": weights.tolist(),
        "logistic_offset": -1.0,
        "severity": (weights / 2).tolist(),
        "severity_offset": 0.2,
        "grids": {"balanced": {"dual_multiplier": 0.2, "multipliers": list(multiplier_grid(0.2))}},
        **changes,
    }


def fit(**changes: Any) -> RiskFit:
    return RiskFit.model_validate(document(**changes))


def test_a_document_survives_its_json() -> None:
    assert RiskFit.model_validate_json(fit().model_dump_json()) == fit()
    assert RiskFit.model_validate_json(json.dumps(document())) == fit()


def test_risk_is_probability_plus_severity() -> None:
    nothing = {"logistic": [0.0] * K, "severity": [0.0] * K}
    found = risk(fit(**nothing), FOUND.scalars, nominal=0)
    assert (found[:, 0] == 0).all()
    assert found[:, 1:] == pytest.approx(1 / (1 + math.e) + 0.2)
    high = risk(fit(**nothing, severity_offset=9.0, logistic_offset=1e6), FOUND.scalars, nominal=0)
    assert high[:, 1:] == pytest.approx(4)
    low = risk(fit(**nothing, severity_offset=-9.0, logistic_offset=-1e6), FOUND.scalars, nominal=0)
    assert (low == 0).all()


def test_one_weight_works_on_one_standardised_feature() -> None:
    place = [feature.name for feature in FEATURES].index("displacement_difference_m")
    weights = np.eye(K)[place]
    found = risk(fit(logistic=(-weights).tolist(), severity=[0.0] * K, severity_offset=0.0), FOUND.scalars, nominal=0)
    mean = FOUND.scalars.mean(axis=0)[..., 2]
    wanted = 1 / (1 + np.exp(np.clip((mean - mean[:, :1]) / 2, -8, 8) + 1))
    assert found[:, 1:] == pytest.approx(wanted[:, 1:])


@settings(max_examples=30)
@given(st.integers(1, 12), st.floats(0.01, 20))
def test_risk_never_rises_with_predicted_separation(candidate: int, more: float) -> None:
    raised = FOUND.scalars.copy()
    raised[:, :, candidate, 1] += more
    here, there = risk(fit(), FOUND.scalars, nominal=0), risk(fit(), raised, nominal=0)
    assert (there[:, candidate] <= here[:, candidate] + 1e-12).all()
    assert (np.delete(there, candidate, axis=1) == np.delete(here, candidate, axis=1)).all()


def test_the_path_goes_from_nominal_to_the_best_predicted_utility() -> None:
    path = guarded_path(
        fit(), FOUND.scalars, nominal=0, scale=SCALE, profile=PROFILES["balanced"], profile_name="balanced"
    )
    utilities = predicted_utility(FOUND.scalars.mean(axis=0), SCALE, PROFILES["balanced"])
    assert path.selections.shape == (102, 25)
    assert (path.selections[0] == 0).all()
    assert path.selections[-1].tolist() == utilities.argmax(axis=1).tolist()
    with pytest.raises(ValueError, match=r"no multiplier grid of the profile 'safety'; there are \['balanced'\]"):
        guarded_path(fit(), FOUND.scalars, nominal=0, scale=SCALE, profile=PROFILES["safety"], profile_name="safety")


def test_candidates_have_keys_not_places() -> None:
    order = np.random.default_rng(1).permutation(13)
    here = risk(fit(), FOUND.scalars, nominal=0)
    there = risk(fit(), FOUND.scalars[:, :, order], nominal=int(np.flatnonzero(order == 0)[0]))
    np.testing.assert_allclose(there, here[:, order], atol=1e-12)


@each(
    "changes",
    [
        {"logistic": [0.1] + [0.0] * (K - 1)},
        {"severity": [0.0] * 4 + [-0.1] + [0.0] * (K - 5)},
        {"logistic": [0.0] * (K - 1)},
        {"severity": [0.0] * (K + 1)},
        {"logistic_offset": math.nan},
        {"logistic_offset": 1e7},
        {"centre": [math.inf] * K},
        {"spread": [0.0] * K},
        {"spread_m": 0.0},
        {"tolerance_m": -0.1},
        {"features": ["a"] * K},
        {"features": [feature.name for feature in FEATURES][::-1]},
        {"grids": {}},
        {"grids": {"balanced": {"dual_multiplier": 0.1, "multipliers": [0.1, 0.1]}}},
        {"grids": {"balanced": {"dual_multiplier": 0.1, "multipliers": [0.1, 0.2]}}},
        {"grids": {"balanced": {"dual_multiplier": 0.1, "multipliers": [0.1, 0.0]}}},
        {"grids": {"balanced": {"dual_multiplier": -0.1, "multipliers": [0.2, 0.1]}}},
        {"grids": {"balanced": {"dual_multiplier": 0.1, "multipliers": [1 / place for place in range(1, 1003)]}}},
        {"more": 1},
    ],
)
def test_a_broken_document_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        fit(**changes)


def test_a_grid_is_what_it_says() -> None:
    assert MultiplierGrid(dual_multiplier=0.2, multipliers=multiplier_grid(0.2)) == fit().grids["balanced"]
