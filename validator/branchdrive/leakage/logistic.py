"""Multinomial logistic regression.

With rows ``x`` (a 1 appended for the intercept), classes ``y`` and weights ``W`` it minimises::

    sum_i -log softmax(x_i W)_{y_i} + penalty / 2 |W|^2

which is strictly convex, by Newton steps, halved until the objective falls: no randomness, one solution. The step
that is found too small to go on is taken as well, so that weights do not depend on where iterations end.

Source: Böhning 1992 (Newton steps for the multinomial model).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["fit_logistic", "log_probability"]

Array = NDArray[np.float64]

_MAX_STEPS = 50
_MAX_HALVINGS = 30
_TOLERANCE = 1e-10


def log_probability(features: Array, weights: Array) -> Array:
    """Natural logarithm of the probability of every class, ``[..., classes]``.

    Args:
        features: ``[..., features]``.
        weights: ``[features + 1, classes]``, intercepts last.
    """
    logits = features @ weights[:-1] + weights[-1]
    logits = logits - logits.max(axis=-1, keepdims=True)
    return np.asarray(logits - np.log(np.exp(logits).sum(axis=-1, keepdims=True)))


def fit_logistic(features: Array, classes: NDArray[np.intp], num_classes: int, *, penalty: float) -> Array:
    """Weights ``[features + 1, classes]``, intercepts last.

    Args:
        features: ``[rows, features]``, finite.
        classes: ``[rows]``, in ``0 .. num_classes - 1``.
        num_classes: At least 2.
        penalty: Above 0.
    """
    x = np.concatenate([features, np.ones((len(features), 1))], axis=1)
    truth = np.eye(num_classes)[classes]
    weights = np.zeros((x.shape[1], num_classes))

    def objective(w: Array) -> float:
        fit = float(np.sum(log_probability(features, w) * truth))
        return 0.5 * penalty * float(np.sum(w * w)) - fit

    value = objective(weights)
    for _ in range(_MAX_STEPS):
        p = np.exp(log_probability(features, weights))
        gradient = x.T @ (p - truth) + penalty * weights
        step = np.linalg.solve(_curvature(x, p, penalty), gradient.T.reshape(-1))
        step = step.reshape(num_classes, -1).T
        decrement = float(np.sum(step * gradient))
        if decrement <= _TOLERANCE * (1.0 + abs(value)):
            return weights - step
        for halving in range(_MAX_HALVINGS):
            tried = weights - step / 2**halving
            reached = objective(tried)
            if reached < value:
                break
        else:
            break
        weights, value = tried, reached
    return weights


def _curvature(x: Array, p: Array, penalty: float) -> Array:
    """Second derivative, ``[classes * (features + 1)]`` squared, classes outermost."""
    num_features, num_classes = x.shape[1], p.shape[1]
    blocks = np.empty((num_classes, num_features, num_classes, num_features))
    for first in range(num_classes):
        for second in range(first, num_classes):
            weight = p[:, first] * ((first == second) - p[:, second])
            block = (x * weight[:, None]).T @ x
            blocks[first, :, second] = block
            blocks[second, :, first] = block.T
    curvature = blocks.reshape(num_classes * num_features, -1)
    curvature[np.diag_indices(len(curvature))] += penalty
    return curvature
