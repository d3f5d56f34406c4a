"""Features of risk: known values, and that separation reaches them in one direction alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.validator.benchmark.guard.banks import banks

from branchdrive.benchmark.guard.risk import FEATURES, risk_features, seed_spread_m, separation_margin

NAMES = [feature.name for feature in FEATURES]
SCALARS = banks(20, seed=3).scalars


def features(scalars: np.ndarray, nominal: int = 0) -> np.ndarray:
    return risk_features(scalars, nominal=nominal, tolerance_m=0.25, spread_m=0.4)


def test_features_of_one_known_candidate() -> None:
    scalars = np.zeros((2, 1, 2, 6))
    scalars[:, 0, 0] = [5, 4, 10, 1, 1, 0.1]
    scalars[0, 0, 1] = [3, 2, 7, 2, 1.5, 0.3]
    scalars[1, 0, 1] = [3, 3, 7, 2, 1.5, 0.3]
    wanted = {
        "margin_m": -1.25,
        "shortfall_m": -1.25,
        "near_margin_m": -1,
        "margin_in_spreads": -1.25 / 0.9,
        "closeness": np.exp(-1.25),
        "spread_m": 0.5,
        "nominal_separation_m": 4,
        "nominal_closeness": np.exp(-2),
        "nominal_displacement_m": 10,
        "nominal_ttc_s": 5,
        "displacement_difference_m": -3,
        "displacement_lost_m": -3,
        "jerk_difference_mps3": 1,
        "accel_difference_mps2": 0.5,
        "yaw_rate_difference_radps": 0.2,
        "ttc_difference_s": -2,
    }
    assert dict(zip(NAMES, features(scalars)[0, 1], strict=True)) == pytest.approx(wanted)


def test_one_seed_has_no_spread() -> None:
    margin, spread = separation_margin(SCALARS[:1], nominal=0, tolerance_m=0.25)
    assert (spread == 0).all()
    assert (margin[:, 0] == 0.25).all()
    assert seed_spread_m(SCALARS[:1], nominal=0) == 1e-3
    assert seed_spread_m(SCALARS, nominal=0) > 0.01


@settings(max_examples=30)
@given(st.integers(1, 12), st.floats(0.01, 20))
def test_more_predicted_separation_moves_features_by_their_sign_alone(candidate: int, more: float) -> None:
    raised = SCALARS.copy()
    raised[:, :, candidate, 1] += more
    moved = features(raised) - features(SCALARS)
    assert (np.delete(moved, candidate, axis=1) == 0).all()
    for place, feature in enumerate(FEATURES):
        column = moved[:, candidate, place]
        if feature.sign:
            assert (column * feature.sign <= 1e-9).all(), feature.name
        else:
            np.testing.assert_allclose(column, 0, atol=1e-9, err_msg=feature.name)


@given(st.permutations(range(20)), st.permutations(range(13)), st.permutations(range(3)))
def test_orders_do_not_matter(groups: list[int], candidates: list[int], seeds: list[int]) -> None:
    moved = SCALARS[seeds][:, groups][:, :, candidates]
    there = features(moved, candidates.index(0))
    np.testing.assert_allclose(there, features(SCALARS)[groups][:, candidates], atol=1e-9)


def test_broken_predictions_are_refused() -> None:
    for shape in ((3, 2, 13), (0, 2, 13, 6), (3, 2, 13, 5)):
        with pytest.raises(ValueError, match=r"expected \[seeds, groups, candidates, 6\]"):
            features(np.zeros(shape))
    with pytest.raises(ValueError, match="1 predicted values are not finite"):
        features(np.where(np.arange(6 * 13).reshape(1, 1, 13, 6) == 7, np.inf, 1.0))
    with pytest.raises(ValueError, match="so large"):
        features(np.array([1e308, -1e308]).repeat(6).reshape(1, 1, 2, 6))
