"""Fitted risk as data: weights, scaling and price grids, all from out-of-fold training predictions.

With features ``f``, standardised and clipped to 8::

    p   = 1 / (1 + exp(-(w f + b)))                     of losing more than eps of separation
    psi = clip(v f + c, 0, 3)                            how much more, metres, at most 3
    rho = p + psi / 1 m                                  0 for nominal

Evaluation is numpy; fitting is elsewhere. The document is strict: a weight that breaks the direction its feature
must have is refused, so that a document proves that risk never rises with predicted separation.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from branchdrive.benchmark.guard.path import SelectionPath, selection_path
from branchdrive.benchmark.guard.risk_features import FEATURES, risk_features
from branchdrive.driving.utility import Profile, Scale, predicted_utility

__all__ = ["CLIP_SD", "SEVERITY_M", "PriceGrid", "RiskFit", "guarded_path", "probability", "risk", "standardised"]

Array = NDArray[np.float64]

CLIP_SD = 8.0
"""Standardised features are clipped to this many standard deviations."""

SEVERITY_M = 3.0
"""Largest severity, metres."""

_Number = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_K = len(FEATURES)
_Weights = Annotated[tuple[_Number, ...], Field(min_length=_K, max_length=_K, strict=False)]


class PriceGrid(BaseModel):
    """Prices of risk for one profile.

    Attributes:
        dual_price: Of the violation budget in the knapsack over training groups.
        prices: Finite, positive, falling; the path adds ``inf`` and 0.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    dual_price: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    prices: Annotated[tuple[_Positive, ...], Field(min_length=2, max_length=1000, strict=False)]

    @model_validator(mode="after")
    def _falls(self) -> Self:
        if any(low >= high for high, low in pairwise(self.prices)):
            raise ValueError("prices must fall")
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
        grids: Prices by name of the profile.

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
    grids: Annotated[dict[str, PriceGrid], Field(min_length=1, max_length=64)]

    @model_validator(mode="after")
    def _directions_hold(self) -> Self:
        if self.features != tuple(feature.name for feature in FEATURES):
            raise ValueError(f"features are {[feature.name for feature in FEATURES]} in this order")
        for name in ("logistic", "severity"):
            for weight, feature in zip(getattr(self, name), FEATURES, strict=True):
                if weight * feature.sign < 0:
                    raise ValueError(f"`{name}` weighs {feature.name!r} by {weight!r}: risk would rise with separation")
        return self


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
        raise ValueError(f"no price grid of the profile {profile_name!r}; there are {sorted(fit.grids)}")
    risks = risk(fit, scalars, nominal=nominal)
    utilities = predicted_utility(scalars.mean(axis=0), scale, profile)
    gains = utilities - utilities[:, nominal, None]
    return selection_path(gains, risks, fit.grids[profile_name].prices, nominal=nominal)


def _weighed(rows: Array, weights: Sequence[float]) -> Array:
    """Weighted sum over the last axis, one feature after the other: equal rows have equal sums wherever they stand."""
    total = np.zeros(rows.shape[:-1])
    for place, weight in enumerate(weights):
        total = total + weight * rows[..., place]
    return total
