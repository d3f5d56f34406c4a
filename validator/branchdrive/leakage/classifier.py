"""Classifiers of the paper's battery: a multinomial logistic regression, and classifiers of sequences from outside.

With rows ``x`` (a 1 appended for the intercept), classes ``y`` and weights ``W`` the regression minimises::

    sum_i -log softmax(x_i W)_{y_i} + penalty / 2 |W|^2

which is strictly convex, by Newton steps, halved until the objective falls: no randomness, one solution. The step
that is found too small to go on is taken as well, so that weights do not depend on where iterations end.

For classifiers of sequences the core asks what is registered in the entry-point group `branchdrive.leakage`; the
extra `models` does.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage" (three recurrent classifiers); Böhning 1992
(Newton steps for the multinomial model).
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import entry_points
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "ENTRY_POINTS", "SequenceClassifier", "SequenceScores", "SequenceTask", "Unavailable", "fit_logistic",
    "log_probability", "sequence_classifier",
]  # fmt: skip

Array = NDArray[np.float64]

_MAX_STEPS = 50
_MAX_HALVINGS = 30
_TOLERANCE = 1e-10

ENTRY_POINTS = "branchdrive.leakage"
"""Entry-point group that names a sequence classifier."""


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


class SequenceTask(NamedTuple):
    """Standardised sequences ``[groups, actions, steps, variables]``; the place among the actions is the class.

    Attributes:
        train: To fit on.
        val: To stop by.
        test: To score.
    """

    train: Array
    val: Array
    test: Array


class SequenceScores(NamedTuple):
    """Scores of the rows to test.

    Attributes:
        log_probability: ``[groups, actions, classes]``, natural logarithm; the classes of a row sum to 1.
        num_epochs: Epochs trained.
        best_epoch: Epoch whose weights scored, counted from 1.
    """

    log_probability: Array
    num_epochs: int
    best_epoch: int


class SequenceClassifier(Protocol):
    """A classifier of sequences whose scores are a function of the task and the seed."""

    @property
    def settings(self) -> Mapping[str, int | float | str]:
        """What it fixes before it sees data, for the report; its `name` is among it."""

    def __call__(self, task: SequenceTask, *, seed: int) -> SequenceScores:
        """Fit on `train`, stop by `val`, and score `test`."""


class Unavailable(NamedTuple):
    """Why there is no sequence classifier: one sentence with what to do."""

    reason: str


def sequence_classifier() -> SequenceClassifier | Unavailable:
    """The installed sequence classifier; none is chosen where there are several."""
    found = sorted(entry_points(group=ENTRY_POINTS), key=lambda point: point.name)
    if not found:
        return Unavailable("no sequence classifier is installed; the extra `models` brings one")
    if len(found) > 1:
        names = ", ".join(f"`{point.name}`" for point in found)
        return Unavailable(f"several sequence classifiers are installed: {names}; uninstall all but one")
    try:
        classifier: SequenceClassifier = found[0].load()
    except ImportError as missing:
        return Unavailable(f"needs the package `{missing.name or found[0].module}`, which the extra `models` brings")
    return classifier
