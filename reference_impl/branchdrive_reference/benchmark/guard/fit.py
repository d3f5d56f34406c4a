"""Fit of the learned risk on out-of-fold training predictions, by two regressions and one knapsack per profile.

With standardised features ``f`` of an intervention, ``d`` its executed separation minus the nominal one::

    logistic   min mean log(1 + exp(z)) - [d < -eps - 1e-9] z + r |w|^2          z = w f + b
    severity   min mean huber_1(v f + c - min(max(-d - eps, 0), 3)) + r |v|^2

both under the signs that `FEATURES` of the risk demand of the weights. Out of fold, because residuals of
groups that a predictor was fitted on are too small.

Source: this project's choice.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.guard.calibration import ALPHA
from branchdrive.benchmark.guard.path import TOLERANCE_M, multiplier_grid
from branchdrive.benchmark.guard.risk import (
    FEATURES,
    SEVERITY_M,
    MultiplierGrid,
    RiskFit,
    probability,
    risk_features,
    seed_spread_m,
    standardised,
)
from branchdrive.driving.target import TARGETS, Targets
from branchdrive.driving.utility import PROFILES, TIE, Profile, Scale, predicted_utility
from branchdrive.errors import UsageError
from branchdrive_reference.benchmark.guard.knapsack import dual_multiplier
from branchdrive_reference.benchmark.guard.program import cvxpy, solve
from branchdrive_reference.benchmark.guard.regression import HUBER, LOGISTIC, Regression

__all__ = ["PENALTY", "fit_risk"]

Array = NDArray[np.float64]

PENALTY = 2e-3
"""``r``, on standardised weights."""

_SIGNS = np.array([feature.sign for feature in FEATURES], np.float64)
_LEAST_SPREAD = 1e-9
"""Features that vary by less, in their unit or as a part of their largest value, vary by rounding and count as 0."""

_SEPARATION = [target.name for target in TARGETS].index("min_separation_m")


def fit_risk(
    scalars: Array,
    outcomes: Targets,
    *,
    nominal: int,
    scale: Scale,
    profiles: Mapping[str, Profile] = PROFILES,
    tolerance_m: float = TOLERANCE_M,
    alpha: float = ALPHA,
    penalty: float = PENALTY,
) -> RiskFit:
    """Fit the risk of losing separation on training groups that have every separation; others are left out.

    Args:
        scalars: Out-of-fold predicted targets of training groups ``[seeds, groups, candidates, 6]``.
        outcomes: Their executed targets ``[groups, candidates, 6]``.
        nominal: Place of the nominal candidate.
        scale: Quantiles of the training partition.
        profiles: Profiles that get a multiplier grid.
        tolerance_m: ``eps``.
        alpha: Budget of the knapsack.
        penalty: ``r``, above 0.

    Raises:
        UsageError: Shapes do not match, or training holds no violation or nothing but violations.
        ValueError: A prediction is not finite.
        ProgramError: The minimum of a regression was not found.
    """
    if scalars.ndim != 4 or scalars.shape[1:] != outcomes.values.shape:
        raise UsageError(
            f"predictions {list(scalars.shape)} and outcomes {list(outcomes.values.shape)} do not match: "
            "[seeds, groups, candidates, 6] and [groups, candidates, 6]"
        )
    has_separation = outcomes.available[..., _SEPARATION].all(axis=1)
    found, separation = scalars[:, has_separation], outcomes.values[has_separation, :, _SEPARATION]
    difference = np.delete(separation - separation[:, nominal, None], nominal, axis=1)
    violated = difference < -tolerance_m - TIE
    if not violated.any() or violated.all():
        raise UsageError(
            f"{int(violated.sum())} of {violated.size} interventions of {len(separation)} training groups lose "
            f"more than {tolerance_m:g} m of separation; learning a risk needs some that do and some that do not"
        )
    spread_m = seed_spread_m(found, nominal=nominal)
    features = risk_features(found, nominal=nominal, tolerance_m=tolerance_m, spread_m=spread_m)
    features = np.delete(features, nominal, axis=1)
    flat = features.reshape(-1, len(FEATURES))
    centre, spread = flat.mean(axis=0), flat.std(axis=0)
    varies = spread > _LEAST_SPREAD * np.maximum(np.abs(flat).max(axis=0), 1.0)
    spread = np.where(varies, spread, 1.0)
    rows = standardised(flat, centre, spread)
    label = violated.reshape(-1).astype(np.float64)
    severity = np.clip(-difference - tolerance_m, 0.0, SEVERITY_M).reshape(-1)

    *weights, offset = solve(
        Regression(rows, label, LOGISTIC, signs=_SIGNS, penalty=penalty), _logistic, "logistic fit of violations"
    ).tolist()
    *severity_weights, severity_offset = solve(
        Regression(rows, severity, HUBER, signs=_SIGNS, penalty=penalty), _huber, "Huber fit of their severity"
    ).tolist()
    chances = probability(rows, weights, offset).reshape(violated.shape)
    grids = {}
    for name, profile in profiles.items():
        utilities = predicted_utility(found.mean(axis=0), scale, profile)
        gains = np.delete(utilities - utilities[:, nominal, None], nominal, axis=1)
        multiplier = dual_multiplier(gains, chances, alpha=alpha)
        grids[name] = MultiplierGrid(dual_multiplier=multiplier, multipliers=multiplier_grid(multiplier))
    return RiskFit(
        features=tuple(feature.name for feature in FEATURES),
        tolerance_m=float(tolerance_m),
        spread_m=spread_m,
        centre=tuple(centre.tolist()),
        spread=tuple(spread.tolist()),
        logistic=tuple(weights),
        logistic_offset=offset,
        severity=tuple(severity_weights),
        severity_offset=severity_offset,
        grids=grids,
    )


def _logistic(z: Any, label: Array) -> Any:
    return cvxpy.logistic(z) - cvxpy.multiply(label, z)


def _huber(z: Any, severity: Array) -> Any:
    return cvxpy.huber(z - severity)
