"""The learned risk of losing separation: what it reads of a candidate, and its fit as data.

It reads predictions and nothing else. With predicted targets of seeds ``s``, means over seeds without index, nominal
``0``, tolerance ``eps``, and the spread over seeds ``sd`` (population) of ``y_a - y_0`` for the separation ``y``::

    z = y_a - y_0 + eps        what is left of the tolerance

The first features rise with ``z`` and their weights are at most 0, ``closeness`` falls with it and its weight is
at least 0. No other feature depends on ``y_a`` but through its spread. So whatever the weights, risk never
rises when every seed predicts the same larger separation for a candidate and nothing else changes.

With features ``f``, standardised and clipped to 8::

    p   = 1 / (1 + exp(-(w f + b)))                     of losing more than eps of separation
    psi = clip(v f + c, 0, 3)                            how much more, metres, at most 3
    rho = p + psi / 1 m                                  0 for nominal

Weights, scaling and multiplier grids are fitted elsewhere, on out-of-fold training predictions; evaluation is numpy.
The document is strict: a weight that breaks the direction its feature must have is refused, so that a document proves
that risk never rises with predicted separation.

Source: this project's choice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Annotated, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from branchdrive.benchmark.guard.path import SelectionPath, selection_path
from branchdrive.driving.target import TARGETS
from branchdrive.driving.utility import Profile, Scale, predicted_utility

__all__ = [
    "CLIP_SD",
    "FEATURES",
    "SEVERITY_M",
    "MultiplierGrid",
    "RiskFeature",
    "RiskFit",
    "Risks",
    "guarded_path",
    "probability",
    "risk",
    "risk_features",
    "seed_spread_m",
    "separation_margin",
    "standardised",
]

Array = NDArray[np.float64]

_PLACE = {target.name: place for place, target in enumerate(TARGETS)}
_CLOSE_M = 2.0
_NEAR_M = 1.0
_SPREADS = 8.0


class RiskFeature(NamedTuple):
    """One feature: its name, and the sign its weight must have, -1, 0 for any, 1."""

    name: str
    sign: int


FEATURES = (
    RiskFeature("margin_m", -1),
    RiskFeature("shortfall_m", -1),
    RiskFeature("near_margin_m", -1),
    RiskFeature("margin_in_spreads", -1),
    RiskFeature("closeness", 1),
    RiskFeature("spread_m", 0),
    RiskFeature("nominal_separation_m", 0),
    RiskFeature("nominal_closeness", 0),
    RiskFeature("nominal_displacement_m", 0),
    RiskFeature("nominal_ttc_s", 0),
    RiskFeature("displacement_difference_m", 0),
    RiskFeature("displacement_lost_m", 0),
    RiskFeature("jerk_difference_mps3", 0),
    RiskFeature("accel_difference_mps2", 0),
    RiskFeature("yaw_rate_difference_radps", 0),
    RiskFeature("ttc_difference_s", 0),
)
"""Features in the order of the last axis."""


def separation_margin(scalars: Array, *, nominal: int, tolerance_m: float) -> tuple[Array, Array]:
    """Mean over seeds of ``z`` and the spread of it, each ``[groups, candidates]``, metres.

    Args:
        scalars: Predicted targets ``[seeds, groups, candidates, 6]``.
        nominal: Place of the nominal candidate.
        tolerance_m: ``eps``.

    Raises:
        ValueError: The shape is another, or a prediction is not finite.
    """
    if scalars.ndim != 4 or not len(scalars) or scalars.shape[3] != len(TARGETS):
        raise ValueError(f"predictions have shape {list(scalars.shape)}, expected [seeds, groups, candidates, 6]")
    if not np.isfinite(scalars).all():
        raise ValueError(f"{np.count_nonzero(~np.isfinite(scalars))} predicted values are not finite")
    separation = scalars[..., _PLACE["min_separation_m"]]
    difference = separation - separation[:, :, nominal, None]
    return difference.mean(axis=0) + tolerance_m, difference.std(axis=0)


def seed_spread_m(scalars: Array, *, nominal: int) -> float:
    """Median spread over seeds of the interventions' separation differences, at least 1e-3, metres.

    It steadies the ratio of margin and spread, and is fixed on training predictions.
    """
    spread = separation_margin(scalars, nominal=nominal, tolerance_m=0.0)[1]
    return max(float(np.median(np.delete(spread, nominal, axis=1))), 1e-3)


def risk_features(scalars: Array, *, nominal: int, tolerance_m: float, spread_m: float) -> Array:
    """Features ``[groups, candidates, features]`` of predicted targets ``[seeds, groups, candidates, 6]``.

    Args:
        scalars: Predicted targets, physical units.
        nominal: Place of the nominal candidate.
        tolerance_m: ``eps``.
        spread_m: `seed_spread_m` of the training predictions.

    Raises:
        ValueError: The shape is another, or a prediction is not finite.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        found = _features(scalars, nominal=nominal, tolerance_m=tolerance_m, spread_m=spread_m)
    if not np.isfinite(found).all():
        raise ValueError("predictions are so large that their differences are no numbers")
    return found


def _features(scalars: Array, *, nominal: int, tolerance_m: float, spread_m: float) -> Array:
    margin, spread = separation_margin(scalars, nominal=nominal, tolerance_m=tolerance_m)
    mean = scalars.mean(axis=0)
    difference = mean - mean[:, nominal, None]

    def of(values: Array, target: str) -> Array:
        return values[..., _PLACE[target]]

    def at_nominal(target: str) -> Array:
        return np.broadcast_to(of(mean, target)[:, nominal, None], margin.shape)

    nominal_separation = at_nominal("min_separation_m")
    displacement = of(difference, "displacement_m")
    columns = {
        "margin_m": margin,
        "shortfall_m": np.minimum(margin, 0.0),
        "near_margin_m": np.clip(margin, -_NEAR_M, _NEAR_M),
        "margin_in_spreads": np.clip(margin / (spread + spread_m), -_SPREADS, _SPREADS),
        "closeness": np.exp(-np.maximum(nominal_separation + (margin - tolerance_m), 0.0) / _CLOSE_M),
        "spread_m": spread,
        "nominal_separation_m": nominal_separation,
        "nominal_closeness": np.exp(-np.maximum(nominal_separation, 0.0) / _CLOSE_M),
        "nominal_displacement_m": at_nominal("displacement_m"),
        "nominal_ttc_s": at_nominal("min_ttc_s"),
        "displacement_difference_m": displacement,
        "displacement_lost_m": np.minimum(displacement, 0.0),
        "jerk_difference_mps3": of(difference, "mean_jerk_mps3"),
        "accel_difference_mps2": of(difference, "max_accel_mps2"),
        "yaw_rate_difference_radps": of(difference, "max_yaw_rate_radps"),
        "ttc_difference_s": of(difference, "min_ttc_s"),
    }
    return np.stack([columns[feature.name] for feature in FEATURES], axis=-1)


CLIP_SD = 8.0
"""Standardised features are clipped to this many standard deviations."""

SEVERITY_M = 3.0
"""Largest severity, metres."""

_Number = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_K = len(FEATURES)
_Weights = Annotated[tuple[_Number, ...], Field(min_length=_K, max_length=_K, strict=False)]


class MultiplierGrid(BaseModel):
    """Multipliers of risk for one profile.

    Attributes:
        dual_multiplier: Of the violation budget in the knapsack over training groups.
        multipliers: Finite, positive, falling; the path adds ``inf`` and 0.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    dual_multiplier: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    multipliers: Annotated[tuple[_Positive, ...], Field(min_length=2, max_length=1000, strict=False)]

    @model_validator(mode="after")
    def _falls(self) -> Self:
        if any(low >= high for high, low in pairwise(self.multipliers)):
            raise ValueError("multipliers must fall")
        return self


class RiskFit(BaseModel):
    """Learned risk, complete: with predictions it gives the selection path of every profile.

    Attributes:
        features: Names, in the order of the weights.
        tolerance_m: ``eps``.
        spread_m: Median spread over seeds in training, metres.
        centre: Means of the features in training.
        spread: Their standard deviations.
        logistic: ``w``.
        logistic_offset: ``b``.
        severity: ``v``, metres.
        severity_offset: ``c``, metres.
        grids: Multipliers by name of the profile.

    Raises:
        pydantic.ValidationError: A number is out of range, a weight has the wrong sign, or features differ.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    features: Annotated[tuple[str, ...], Field(max_length=_K, strict=False)]
    tolerance_m: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    spread_m: _Positive
    centre: _Weights
    spread: Annotated[tuple[_Positive, ...], Field(min_length=_K, max_length=_K, strict=False)]
    logistic: _Weights
    logistic_offset: _Number
    severity: _Weights
    severity_offset: _Number
    grids: Annotated[dict[str, MultiplierGrid], Field(min_length=1, max_length=64)]

    @model_validator(mode="after")
    def _directions_hold(self) -> Self:
        if self.features != tuple(feature.name for feature in FEATURES):
            raise ValueError(f"features are {[feature.name for feature in FEATURES]} in this order")
        for name in ("logistic", "severity"):
            for weight, feature in zip(getattr(self, name), FEATURES, strict=True):
                if weight * feature.sign < 0:
                    raise ValueError(f"`{name}` weighs {feature.name!r} by {weight!r}: risk would rise with separation")
        return self


Risks = Mapping[tuple[str, float], RiskFit]
"""Learned risks by the guarded model and the tolerance in metres."""


def standardised(features: Array, centre: Array, spread: Array) -> Array:
    """Features ``[..., features]`` in standard deviations from their means, clipped."""
    with np.errstate(over="ignore"):
        return np.clip((features - centre) / spread, -CLIP_SD, CLIP_SD)


def probability(rows: Array, weights: Sequence[float], offset: float) -> Array:
    """``p`` ``[...]`` of standardised features ``[..., features]``."""
    # tanh keeps the logistic function from overflowing.
    return 0.5 + 0.5 * np.tanh((_weighed(rows, weights) + offset) / 2.0)


def risk(fit: RiskFit, scalars: Array, *, nominal: int) -> Array:
    """Learned risk ``[groups, candidates]`` of predicted targets ``[seeds, groups, candidates, 6]``.

    Raises:
        ValueError: The shape is another, or a prediction is not finite.
    """
    found = risk_features(scalars, nominal=nominal, tolerance_m=fit.tolerance_m, spread_m=fit.spread_m)
    rows = standardised(found, np.array(fit.centre), np.array(fit.spread))
    severity = np.clip(_weighed(rows, fit.severity) + fit.severity_offset, 0.0, SEVERITY_M)
    rho = probability(rows, fit.logistic, fit.logistic_offset) + severity
    rho[:, nominal] = 0.0
    return np.asarray(rho)


def guarded_path(
    fit: RiskFit, scalars: Array, *, nominal: int, scale: Scale, profile: Profile, profile_name: str
) -> SelectionPath:
    """The selection path of one profile on predicted targets, utilities from their mean over seeds.

    Args:
        fit: Learned risk.
        scalars: Predicted targets ``[seeds, groups, candidates, 6]``.
        nominal: Place of the nominal candidate.
        scale: Quantiles of the training partition.
        profile: What is preferred.
        profile_name: Its name in `RiskFit.grids`.

    Raises:
        ValueError: The fit has no grid of that profile, the shape is another, or a prediction is not finite.
    """
    if profile_name not in fit.grids:
        raise ValueError(f"no multiplier grid of the profile {profile_name!r}; there are {sorted(fit.grids)}")
    risks = risk(fit, scalars, nominal=nominal)
    utilities = predicted_utility(scalars.mean(axis=0), scale, profile)
    gains = utilities - utilities[:, nominal, None]
    return selection_path(gains, risks, fit.grids[profile_name].multipliers, nominal=nominal)


def _weighed(rows: Array, weights: Sequence[float]) -> Array:
    """Weighted sum over the last axis, one feature after the other: equal rows have equal sums wherever they stand."""
    total = np.zeros(rows.shape[:-1])
    for place, weight in enumerate(weights):
        total = total + weight * rows[..., place]
    return total
