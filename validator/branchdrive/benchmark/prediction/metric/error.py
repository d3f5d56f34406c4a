"""Errors of one prediction of complete banks, group by group.

With the available candidates ``A_gt`` of group ``g`` and target ``t``, and the candidates ``A_g`` whose path
is complete, of which step ``j`` is ``(x, y, s, c, v)``, hats marking predictions::

    absolute_gt = mean over A_gt of |yhat - y|               square_gt = sum over A_gt of (yhat - y)^2
    ADE_g = mean over A_g and j of |(xhat, yhat) - (x, y)|   FDE_g     = mean over A_g of the same at j = 10
    heading_g = mean over A_g and j of |wrap(atan2(shat, chat) - atan2(s, c))| in degrees
    speed_g   = mean over A_g and j of |vhat - v|

A mean over no candidate is NaN.

Source: paper, "Metrics and Statistics".
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.metric.outcome import Outcomes, Predictions
from branchdrive.driving.angle import wrap_rad

__all__ = ["PATH_ERRORS", "GroupErrors", "absolute_errors", "group_errors", "group_mean"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PATH_ERRORS = ("ade_m", "fde_m", "heading_mae_deg", "speed_mae_mps")
"""Errors of a path, in the order of `GroupErrors.path`."""


class GroupErrors(NamedTuple):
    """Errors by group.

    Attributes:
        absolute: ``[N, 6]``, mean over available candidates, in the units of the targets; NaN where none is.
        square: ``[N, 6]``, sum over available candidates.
        num_available: ``[N, 6]``, available candidates.
        path: ``[N, 4]`` in the order of `PATH_ERRORS`; NaN where no path is complete.
    """

    absolute: Array
    square: Array
    num_available: NDArray[np.int64]
    path: Array


def group_errors(outcomes: Outcomes, predictions: Predictions) -> GroupErrors:
    """Errors of `predictions`.

    Raises:
        ValueError: Outcomes and predictions differ in groups or candidates.
    """
    if outcomes.scalars.shape != predictions.scalars.shape:
        raise ValueError(
            f"predictions for {list(predictions.scalars.shape[:2])} groups and candidates do not match outcomes "
            f"of {list(outcomes.scalars.shape[:2])}"
        )
    error = np.abs(predictions.scalars - outcomes.scalars)
    square = np.where(outcomes.available, np.square(error), 0.0).sum(axis=1)
    return GroupErrors(
        group_mean(error, outcomes.available),
        square,
        outcomes.available.sum(axis=1),
        group_mean(_path_errors(outcomes.paths, predictions.paths), outcomes.complete[:, :, None]),
    )


def absolute_errors(outcomes: Outcomes, scalars: Array, places: Array) -> Array:
    """Mean absolute errors of the targets and ADE of many predictions ``[.., N, 7]``, NaN where there is none.

    Args:
        outcomes: Of ``N`` groups.
        scalars: ``[.., N, A, 6]``.
        places: ``x`` and ``y`` of paths ``[.., N, A, 10, 2]``.
    """
    away = places - outcomes.paths[..., :2]
    distance = np.hypot(away[..., 0], away[..., 1]).mean(axis=-1)
    errors = np.concatenate([np.abs(scalars - outcomes.scalars), distance[..., None]], axis=-1)
    return group_mean(errors, np.concatenate([outcomes.available, outcomes.complete[..., None]], axis=-1))


def group_mean(values: Array, mask: Mask) -> Array:
    """Mean over the candidates of a mask ``[N, A, K]``: ``[.., N, A, K]`` to ``[.., N, K]``, NaN for none."""
    count = np.broadcast_to(mask, mask.shape[:-1] + values.shape[-1:]).sum(axis=-2)
    total = np.where(mask, values, 0.0).sum(axis=-2)
    count = np.broadcast_to(count, total.shape)
    return np.asarray(np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0))


def _path_errors(truth: Array, predicted: Array) -> Array:
    """Errors of every candidate, ``[N, A, 4]``."""
    x, y, sin, cos, speed = np.moveaxis(truth, 3, 0)
    x_hat, y_hat, sin_hat, cos_hat, speed_hat = np.moveaxis(predicted, 3, 0)
    distance = np.hypot(x_hat - x, y_hat - y)
    turned = np.abs(wrap_rad(np.arctan2(sin_hat, cos_hat) - np.arctan2(sin, cos)))
    return np.stack(
        [
            distance.mean(axis=2),
            distance[:, :, -1],
            np.rad2deg(turned).mean(axis=2),
            np.abs(speed_hat - speed).mean(axis=2),
        ],
        axis=2,
    )
