"""Normalisation of histories, targets and trajectories, fitted on the training groups of one split.

Every scaling is affine, ``z = (value - offset) / scale``, then limited where a limit is declared::

    state       mean and sd over (training groups x 16) per feature, limited to +-8; one-hots and flags as they are
    controls    mean and sd over (training groups x 80) per control, limited to +-8
    targets     median and interquartile range (linear quantiles) of the available values, per target
    trajectory  mean and sd per step and component; sin and cos as they are

Standard deviations are of the population and at least 1e-3, interquartile ranges at least 1e-6. What is
left as it is has offset 0 and scale 1 and passes unchanged, to the bit; so has a feature that is not recorded,
which no row of a history has. A scaling holds the digest of the split it was fitted on, and it can be fitted in
no other way than through the training rows of that split.
Sums run in the order of the rows: with the groups in sorted order the statistics are reproducible to the bit.

Source: paper, "Model Inputs and Targets" and "Benchmark Protocol" (training statistics only); floors and limits are
this project's choice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.driving.feature import Feature, InputProfile
from branchdrive.driving.history import HistoryInput
from branchdrive.driving.target import TRAJECTORY, Targets, Trajectory
from branchdrive.statistics.split import TRAINING, split_digest

__all__ = [
    "Scaling",
    "Training",
    "fit_controls",
    "fit_state",
    "fit_targets",
    "fit_trajectory",
    "training",
]

Array = NDArray[np.float64]

SD_FLOOR = 1e-3
IQR_FLOOR = 1e-6
HISTORY_LIMIT = 8.0


class Training(NamedTuple):
    """Training rows of one split: `rows` ``[groups]``, and the digest of the split."""

    rows: NDArray[np.bool_]
    split_digest: str


class Scaling(NamedTuple):
    """An affine scaling; the three arrays have the shape of the trailing axes that they apply to.

    Attributes:
        offset: In the units of the values.
        scale: In the units of the values, positive.
        limit: Largest magnitude of a normalised value, ``inf`` where there is none.
        split_digest: Digest of the split whose training partition it was fitted on.
    """

    offset: Array
    scale: Array
    limit: Array
    split_digest: str

    def apply(self, values: ArrayLike) -> Array:
        """Normalised values, of the same shape; NaN stays NaN."""
        found = np.asarray(self._checked(values) - self.offset)
        found /= self.scale
        return np.clip(found, -self.limit, self.limit, out=found)

    def invert(self, normalised: ArrayLike) -> Array:
        """Values in their units, of the same shape; what the limit cut off does not come back."""
        found = np.asarray(self._checked(normalised) * self.scale)
        found += self.offset
        return found

    def _checked(self, values: ArrayLike) -> Array:
        array = np.asarray(values, np.float64)
        if array.shape[array.ndim - self.offset.ndim :] != self.offset.shape:
            raise ValueError(f"values have shape {list(array.shape)}, the last axes not {list(self.offset.shape)}")
        return array


def training(group_ids: Sequence[str], assignment: Mapping[str, str]) -> Training:
    """Training rows among `group_ids` ``[groups]``, which may be a part of the split.

    Raises:
        ValueError: A group is in no partition, or no group is in training.
    """
    missing = [group_id for group_id in group_ids if group_id not in assignment]
    rows = np.array([assignment.get(group_id) == TRAINING for group_id in group_ids], np.bool_)
    if missing or not rows.any():
        found = f"group {missing[0]!r} is in no partition" if missing else "no group is in training"
        raise ValueError(f"{found}, of {len(group_ids)} groups and an assignment of {len(assignment)}")
    return Training(rows, split_digest(assignment))


def fit_state(history: HistoryInput, profile: InputProfile, fitted_on: Training) -> Scaling:
    """Scaling ``[features]`` of a state history ``[groups, 16, features]``.

    Raises:
        ValueError: Shapes do not match, or no training row is available.
    """
    return _fit_history(history, profile.state, fitted_on)


def fit_controls(history: HistoryInput, profile: InputProfile, fitted_on: Training) -> Scaling:
    """Scaling ``[controls]`` of a control history ``[groups, 80, controls]``.

    Raises:
        ValueError: Shapes do not match, or no training row is available.
    """
    return _fit_history(history, profile.controls, fitted_on)


def fit_targets(targets: Targets, fitted_on: Training) -> Scaling:
    """Scaling ``[6]`` of scalar targets ``[groups, candidates, 6]``.

    A target without any available training value has NaN for offset and scale.

    Raises:
        ValueError: Shapes do not match.
    """
    values = _training_rows(np.where(targets.available, targets.values, np.nan), fitted_on, 3)
    quantiles = np.full((values.shape[2], 3), np.nan)
    for column, row in enumerate(quantiles):
        there = values[..., column][np.isfinite(values[..., column])]
        if there.size:
            row[:] = np.quantile(there, [0.25, 0.5, 0.75])
    low, middle, high = quantiles.T
    return Scaling(middle, np.maximum(high - low, IQR_FLOOR), np.full(len(middle), np.inf), fitted_on.split_digest)


def fit_trajectory(trajectory: Trajectory, fitted_on: Training) -> Scaling:
    """Scaling ``[10, 5]`` of trajectories ``[groups, candidates, 10, 5]``.

    Raises:
        ValueError: Shapes do not match, or a step is available in no training row.
    """
    values = _training_rows(np.where(trajectory.available[..., None], trajectory.values, np.nan), fitted_on, 4)
    kept = np.array([name in ("sin_yaw", "cos_yaw") for name in TRAJECTORY])
    mean, sd = _moments(values.reshape(-1, *values.shape[2:]))
    kept = np.broadcast_to(kept, mean.shape)
    return _standard(mean, sd, kept, np.inf, fitted_on)


def _fit_history(history: HistoryInput, features: Sequence[Feature], fitted_on: Training) -> Scaling:
    values = _training_rows(np.where(history.available[..., None], history.values, np.nan), fitted_on, 3)
    if values.shape[2] != len(features):
        raise ValueError(f"a history of {values.shape[2]} features does not match a profile of {len(features)}")
    if not history.available[fitted_on.rows].any():
        raise ValueError("no training row is available to fit a scaling on")
    is_recorded = np.isfinite(history.values).any(axis=(0, 1))
    mean, sd = np.zeros(len(features)), np.ones(len(features))
    mean[is_recorded], sd[is_recorded] = _moments(values.reshape(-1, values.shape[2])[:, is_recorded])
    kept = np.array([not feature.normalised for feature in features]) | ~is_recorded
    return _standard(mean, sd, kept, HISTORY_LIMIT, fitted_on)


def _training_rows(values: Array, fitted_on: Training, num_axes: int) -> Array:
    if values.ndim != num_axes or len(values) != len(fitted_on.rows):
        raise ValueError(f"values of shape {list(values.shape)} do not match {len(fitted_on.rows)} groups")
    return np.asarray(values[fitted_on.rows])


def _moments(values: Array) -> tuple[Array, Array]:
    """Mean and population standard deviation over the first axis, absent rows left out."""
    if not np.isfinite(values).any(axis=0).all():
        raise ValueError("no training row is available to fit a scaling on")
    mean = np.nanmean(values, axis=0)
    return mean, np.sqrt(np.nanmean(np.square(values - mean), axis=0))


def _standard(mean: Array, sd: Array, kept: NDArray[np.bool_], limit: float, fitted_on: Training) -> Scaling:
    return Scaling(
        np.where(kept, 0.0, mean),
        np.where(kept, 1.0, np.maximum(sd, SD_FLOOR)),
        np.where(kept, np.inf, limit),
        fitted_on.split_digest,
    )
