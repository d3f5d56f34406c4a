"""Utility of executed futures: how desirable each target is, and profiles that weigh them.

With quantiles ``q05`` and ``q95`` of the available values of a target, the desirability of a value is::

    d = clip((y - q05) / (q95 - q05), 0, 1)        reversed, 1 - d, for jerk, acceleration and yaw rate

A profile weighs separation, displacement and comfort; comfort is split evenly over jerk, acceleration
and yaw rate. Without separation there is no utility, and the group leaves the ranking.

Between those quantiles a metre of separation is worth the same at 1 m as at 8 m, so that the last one before contact
hardly counts. A profile with a near range ``R`` scores separation by what the gap is good for instead::

    d = sqrt(clip(y / R, 0, 1))        the closing speed that braking within the gap takes off, as a share of that at R

since ``v^2 = 2 a y`` at a deceleration ``a``, whatever it is. Contact scores 0, and a gap beyond ``R`` no more than one
of ``R``.

Source: paper, "Offline Candidate Ranking" and "Complete-Bank Ranking and Offline Policy Evaluation" (normalised
desirability, balanced profile); the other weights and the near range are this project's choice.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.driving.target import TARGETS, Targets

__all__ = [
    "PROFILES",
    "RANGE",
    "REVERSED",
    "TIE",
    "WEIGHED",
    "Profile",
    "Scale",
    "desirability",
    "extreme_shares",
    "fit_scale",
    "predicted_utility",
    "utility",
]

Array = NDArray[np.float64]

_SPAN_FLOOR = 1e-6
"""Smallest distance of the two quantiles: a target that hardly varies decides nothing and divides by no zero."""

TIE = 1e-9
"""Utilities that differ by no more are equal."""

RANGE = 1e-6
"""Smallest range, gap or gain of utilities that anything is divided by; last bits are too much of a smaller one."""


class Profile(NamedTuple):
    """One preference.

    Attributes:
        separation: Weight; the three add up to 1.
        displacement: Weight.
        comfort: Weight.
        near_m: Near range of separation, metres above 0; ``None`` where separation is scaled by quantiles.
    """

    separation: float
    displacement: float
    comfort: float
    near_m: float | None = None

    @property
    def weights(self) -> Array:
        """Weights of the targets in `WEIGHED`, ``[5]``."""
        return np.array([self.separation, self.displacement, *[self.comfort / 3] * 3])


PROFILES: Mapping[str, Profile] = MappingProxyType(
    {
        "balanced": Profile(1 / 3, 1 / 3, 1 / 3),
        "safety": Profile(0.50, 0.25, 0.25),
        "progress": Profile(0.25, 0.50, 0.25),
        "comfort": Profile(0.25, 0.25, 0.50),
        "near_range": Profile(0.50, 0.25, 0.25, near_m=2.0),
    }
)
"""Profiles by name: the paper's four, and one that scores separation in the near range.

Its weights are those of ``safety``: with half of the weight on separation, contact is never better than a gap of the
near range or more, whatever progress and comfort are.
"""

WEIGHED = ("min_separation_m", "displacement_m", "mean_jerk_mps3", "max_accel_mps2", "max_yaw_rate_radps")
"""Targets that utility weighs, in the order of `Scale` and `desirability`."""

REVERSED = (False, False, True, True, True)
_COLUMNS = [[target.name for target in TARGETS].index(name) for name in WEIGHED]


class Scale(NamedTuple):
    """Quantiles of the targets in `WEIGHED`, each ``[5]`` in the targets' units, NaN where no value was available."""

    q05: Array
    q95: Array


def fit_scale(targets: Targets) -> Scale:
    """Linear 5 % and 95 % quantiles over all available values of `targets`, leading axes of any shape."""
    quantiles = []
    for column in _COLUMNS:
        values = targets.values[..., column][targets.available[..., column]]
        quantiles.append(np.quantile(values, [0.05, 0.95]) if values.size else np.full(2, np.nan))
    return Scale(*np.array(quantiles).T)


def desirability(targets: Targets, scale: Scale, near_m: float | None = None) -> Array:
    """Desirability in ``[0, 1]``, 1 the best: ``[..., 5]`` in the order of `WEIGHED`, NaN where unavailable.

    Where the quantiles are closer than 1e-6 they count as 1e-6 apart.

    Args:
        targets: Leading axes of any shape.
        scale: Quantiles of the training partition.
        near_m: Near range in which separation is scored; ``None`` to score it between its quantiles.
    """
    span = np.maximum(scale.q95 - scale.q05, _SPAN_FLOOR)
    rising = np.clip((targets.values[..., _COLUMNS] - scale.q05) / span, 0.0, 1.0)
    wanted = np.where(REVERSED, 1.0 - rising, rising)
    if near_m is not None:
        wanted[..., 0] = np.sqrt(np.clip(targets.values[..., _COLUMNS[0]] / near_m, 0.0, 1.0))
    return np.where(targets.available[..., _COLUMNS], wanted, np.nan)


def utility(targets: Targets, scale: Scale, profile: Profile) -> Array:
    """Weighted mean of desirabilities in ``[0, 1]``, shape ``[...]``; NaN where a weighed target is unavailable."""
    # No product of matrices: equal futures have equal utilities wherever they stand, on every processor.
    return np.asarray((desirability(targets, scale, profile.near_m) * profile.weights).sum(axis=-1))


def predicted_utility(scalars: Array, scale: Scale, profile: Profile) -> Array:
    """Utility of predicted targets, shape ``[...]``: a prediction is there for every target.

    Args:
        scalars: ``[..., 6]`` in the order of `TARGETS`, physical units.
        scale: Quantiles of the training partition.
        profile: What is preferred.

    Raises:
        ValueError: A prediction or the scale of a weighed target is no finite number.
    """
    found = np.asarray(scalars, np.float64)
    if not np.isfinite(found).all():
        raise ValueError(f"{np.count_nonzero(~np.isfinite(found))} predicted values are not finite")
    if not np.isfinite(scale).all():
        raise ValueError("a weighed target has no quantiles: it was available nowhere in training")
    with np.errstate(over="ignore"):
        return utility(Targets(found, np.ones(found.shape, np.bool_)), scale, profile)


def extreme_shares(utilities: Array) -> tuple[Array, Array]:
    """Which candidates are the best and which the worst of their group.

    Args:
        utilities: ``[groups, candidates]``.

    Returns:
        Shares of the best and of the worst place, each ``[groups, candidates]``: candidates within
        `TIE` of the extreme share it evenly, so that a row adds up to 1. A group in which any
        utility is NaN is not ranked: its rows are NaN.
    """
    shares = []
    for extreme in (utilities.max(axis=1, keepdims=True), utilities.min(axis=1, keepdims=True)):
        holds = (np.abs(utilities - extreme) <= TIE).astype(np.float64)
        count = holds.sum(axis=1, keepdims=True)
        shares.append(np.divide(holds, count, out=np.full_like(holds, np.nan), where=count > 0))
    return shares[0], shares[1]
