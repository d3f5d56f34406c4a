"""What the learned risk of a candidate reads: predictions and nothing else.

With predicted targets of seeds ``s``, means over seeds without index, nominal ``0``, tolerance ``eps``, and the
spread over seeds ``sd`` (population) of ``y_a - y_0`` for the separation ``y``::

    z = y_a - y_0 + eps        what is left of the tolerance

The first features rise with ``z`` and their weights are at most 0, ``closeness`` falls with it and its weight is
at least 0. No other feature depends on ``y_a`` but through its spread. So whatever the weights, risk never
rises when every seed predicts the same larger separation for a candidate and nothing else changes.

Source: this project's choice.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.target import TARGETS

__all__ = ["FEATURES", "RiskFeature", "risk_features", "seed_spread_m", "separation_margin"]

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
