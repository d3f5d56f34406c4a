"""Held-out scores of a classifier of actions, and how surprising they are.

For log-probabilities ``s[g, r, c]`` of class ``c`` at the row of action ``r`` in group ``g``, each measure is the
mean over groups and actions of ``m[g, a, a]``:

* log-likelihood: ``m = s``;
* accuracy: ``m[g, r, c] = 1 / #largest`` where ``c`` is among the largest of its row, else 0, so that who cannot
  decide scores exactly the level of chance.

Labels permuted within groups give ``m[g, pi_g(a), a]``. The interval of the accuracy is that of 2.5 and 97.5 % of
resampled groups.

Source: paper VI-A (accuracy, bootstrap over branches); the log-likelihood is this project's addition, since an
accuracy at chance can hide a classifier that knows something.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.leakage.agreement import rows_agree
from branchdrive.statistics.permutation import draw, p_value
from branchdrive.statistics.stream import counts, words

__all__ = ["MEASURES", "Score", "held_out_score"]

Array = NDArray[np.float64]

MEASURES = ("accuracy", "log_likelihood")
"""Measures, in the order of every axis over measures."""

_HELD_OUT = "leakage/held-out"
_BOOTSTRAP = "leakage/bootstrap"
_TIE = 1e-9
_PERMUTATIONS_AT_ONCE = 500


class Score(NamedTuple):
    """Held-out score of one classifier.

    Attributes:
        accuracy: Share of rows whose action was found.
        accuracy_interval: Its 95 % interval over resampled groups.
        log_likelihood: Mean natural logarithm of the probability of the action.
        p_accuracy: Share of permutations that reach the accuracy, in the form of `p_value`.
        p_log_likelihood: The same of the log-likelihood.
        identical: Whether scores are identical within every group, so that the classifier tells nothing apart.
    """

    accuracy: float
    accuracy_interval: tuple[float, float]
    log_likelihood: float
    p_accuracy: float
    p_log_likelihood: float
    identical: bool


def held_out_score(
    log_probability: ArrayLike, *, seed: int, num_permutations: int, num_resamples: int, atol: float
) -> Score:
    """Score of log-probabilities ``[groups, actions, actions]``, rows by action, classes last.

    Args:
        log_probability: Of groups that nothing was fitted on.
        seed: Of permutations and resamples.
        num_permutations: At least 1.
        num_resamples: At least 1.
        atol: Largest difference of scores that count as identical.

    Raises:
        ValueError: The shape is wrong, there is no group, or a value is not finite.
    """
    scores = np.asarray(log_probability, np.float64)
    if scores.ndim != 3 or not scores.size or scores.shape[1] != scores.shape[2] or not np.isfinite(scores).all():
        raise ValueError(f"scores have shape {list(scores.shape)}, not [groups, actions, actions], or are not finite")
    num_groups, num_actions, _ = scores.shape
    largest = scores >= scores.max(axis=2, keepdims=True) - _TIE
    hits = largest / largest.sum(axis=2, keepdims=True)
    identical = rows_agree(scores, atol=atol)
    actions = np.arange(num_actions)
    per_group = np.stack([m[:, actions, actions].mean(axis=1) for m in (hits, scores)])
    observed = per_group.mean(axis=1)
    low, high = _interval(per_group[0], num_resamples, seed)
    if identical:
        return Score(float(observed[0]), (low, high), float(observed[1]), 1.0, 1.0, True)

    null = np.empty((2, num_permutations))
    groups = np.arange(num_groups)[:, None]
    for start in range(0, num_permutations, _PERMUTATIONS_AT_ONCE):
        stop = min(start + _PERMUTATIONS_AT_ONCE, num_permutations)
        rows = draw(start, stop, num_groups, num_actions, seed=seed, stream=_HELD_OUT)
        for measure, m in enumerate((hits, scores)):
            null[measure, start:stop] = m[groups, rows, actions].mean(axis=(1, 2))
    p = [p_value(float(value), column) for value, column in zip(observed, null, strict=True)]
    return Score(float(observed[0]), (low, high), float(observed[1]), p[0], p[1], False)


def _interval(per_group: Array, num_resamples: int, seed: int) -> tuple[float, float]:
    num_groups = len(per_group)
    drawn = counts(words(seed, _BOOTSTRAP, num_resamples, num_groups), num_groups)
    low, high = np.quantile(drawn @ per_group / num_groups, [0.025, 0.975]).tolist()
    return low, high
