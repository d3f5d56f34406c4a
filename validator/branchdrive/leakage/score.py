"""Held-out scores of classifiers of actions, how surprising they are, and what those of the battery amount to.

For log-probabilities ``s[g, r, c]`` of class ``c`` at the row of action ``r`` in group ``g``, each measure is the
mean over groups and actions of ``m[g, a, a]``:

* log-likelihood: ``m = s``;
* accuracy: ``m[g, r, c] = 1 / #largest`` where ``c`` is among the largest of its row, else 0, so that who cannot
  decide scores exactly the level of chance.

Labels permuted within groups give ``m[g, pi_g(a), a]``. The interval of the accuracy is that of 2.5 and 97.5 % of
resampled groups.

The family of Holm's procedure are both measures of every test that ran, of all ways together. A way is *trusted*
where both measures find both positive controls and neither finds the random labels. The status of a test is

* ``not_run`` where it could not run;
* ``inconclusive`` where its scores are identical within every group, its way is not trusted, or permutations
  are too few for it to fail;
* ``fail`` where an adjusted p is at most `alpha`, and ``pass`` where none is.

It is a diagnostic: what a release may claim is the gate's to say.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage" (accuracy, bootstrap over branches, statuses).
This project adds the log-likelihood, since an accuracy at chance can hide a classifier that knows something, and that
a classifier which tells nothing apart is inconclusive.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.leakage.draw import ONCE, Draw, drawn_here, ranges_of
from branchdrive.leakage.protocol import CONTROLS, BatteryProtocol
from branchdrive.leakage.table import rows_agree
from branchdrive.statistics.holm import holm
from branchdrive.statistics.permutation import p_value
from branchdrive.statistics.random_words import counts, group_orders, words

__all__ = ["MEASURES", "Score", "held_out_score", "judged_battery"]

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
    log_probability: ArrayLike,
    *,
    seed: int,
    num_permutations: int,
    num_resamples: int,
    atol: float,
    draw: Draw = drawn_here,
) -> Score:
    """Score of log-probabilities ``[groups, actions, actions]``, rows by action, classes last.

    Args:
        log_probability: Of groups that nothing was fitted on.
        seed: Of permutations and resamples.
        num_permutations: At least 1.
        num_resamples: At least 1.
        atol: Largest difference of scores that count as identical.
        draw: How ranges of permutations are computed.

    Raises:
        ValueError: The shape is wrong, there is no group, or a value is not finite.
    """
    scores = np.asarray(log_probability, np.float64)
    if scores.ndim != 3 or not scores.size or scores.shape[1] != scores.shape[2] or not np.isfinite(scores).all():
        raise ValueError(f"scores have shape {list(scores.shape)}, not [groups, actions, actions], or are not finite")
    num_actions = scores.shape[1]
    largest = scores >= scores.max(axis=2, keepdims=True) - _TIE
    hits = largest / largest.sum(axis=2, keepdims=True)
    identical = rows_agree(scores, atol=atol)
    actions = np.arange(num_actions)
    per_group = np.stack([m[:, actions, actions].mean(axis=1) for m in (hits, scores)])
    observed = per_group.mean(axis=1)
    [(low, high)] = draw(_interval, (per_group[0], num_resamples, seed), ONCE)
    if identical:
        return Score(float(observed[0]), (low, high), float(observed[1]), 1.0, 1.0, True)

    measures = np.stack([hits, scores])
    found = draw(_null_of, (measures, seed), ranges_of(num_permutations, _PERMUTATIONS_AT_ONCE))
    null = np.concatenate(found, axis=1)
    p = [p_value(float(value), column) for value, column in zip(observed, null, strict=True)]
    return Score(float(observed[0]), (low, high), float(observed[1]), p[0], p[1], False)


def _null_of(subject: tuple[Array, int], numbers: range) -> Array:
    """Measures of permutations ``[measures, permutations]`` of ``m`` ``[measures, groups, actions, actions]``."""
    measures, seed = subject
    _, num_groups, num_actions, _ = measures.shape
    null = np.empty((len(measures), len(numbers)))
    groups, actions = np.arange(num_groups)[:, None], np.arange(num_actions)
    for start in range(numbers.start, numbers.stop, _PERMUTATIONS_AT_ONCE):
        stop = min(start + _PERMUTATIONS_AT_ONCE, numbers.stop)
        rows = group_orders(seed, _HELD_OUT, stop - start, num_groups, num_actions, first_row=start)
        for measure, m in enumerate(measures):
            null[measure, start - numbers.start : stop - numbers.start] = m[groups, rows, actions].mean(axis=(1, 2))
    return null


def _interval(subject: tuple[Array, int, int], _: range) -> tuple[float, float]:
    per_group, num_resamples, seed = subject
    num_groups = len(per_group)
    drawn = counts(words(seed, _BOOTSTRAP, num_resamples, num_groups), num_groups)
    low, high = np.quantile(drawn @ per_group / num_groups, [0.025, 0.975]).tolist()
    return low, high


def judged_battery(ways: Sequence[Mapping[str, Any]], protocol: BatteryProtocol) -> dict[str, Any]:
    """The battery with all that follows from its scores.

    Args:
        ways: Each with `name`, `num_actions`, `num_groups`, and `controls` and `tests` with `name`, `score` (None
            where it could not run), `training` and, for one that could not run, `reason`.
        protocol: Numbers of the battery.
    """
    family = [
        (i, j, measure)
        for i, way in enumerate(ways)
        for j, test in enumerate(way["tests"])
        if test["score"] is not None
        for measure in MEASURES
    ]
    adjusted = holm([ways[i]["tests"][j]["score"][f"p_{measure}"] for i, j, measure in family]).tolist()
    by_test: dict[tuple[int, int], dict[str, float]] = {}
    for (i, j, measure), p in zip(family, adjusted, strict=True):
        by_test.setdefault((i, j), {})[measure] = p
    least = len(family) / (protocol.num_permutations + 1)
    judged = [
        _judged_way(way, [by_test.get((i, j)) for j in range(len(way["tests"]))], least, protocol)
        for i, way in enumerate(ways)
    ]
    ran = [way["trusted"] for way in judged if way["trusted"] is not None]
    names = [f"{ways[i]['name']}/{ways[i]['tests'][j]['name']}/{measure}" for i, j, measure in family]
    return {"trusted": bool(ran) and all(ran), "family": names, "ways": judged}


def _judged_way(
    way: Mapping[str, Any], adjusted: Sequence[dict[str, float] | None], least: float, protocol: BatteryProtocol
) -> dict[str, Any]:
    controls = [_judged_control(control, protocol.control_alpha) for control in way["controls"]]
    astray = [control["name"] for control in controls if control["found"] is not None and not control["as_expected"]]
    ran = all(control["found"] is not None for control in controls)
    trusted = not astray if ran else None
    tests = []
    for test, p in zip(way["tests"], adjusted, strict=True):
        status, reason = _status(test, p, astray, least, protocol)
        tests.append(
            {
                "name": test["name"],
                "score": test["score"],
                "training": test["training"],
                "p_adjusted": p,
                "status": status,
                "reason": reason,
            }
        )
    return {
        "name": way["name"],
        "num_actions": way["num_actions"],
        "chance": 1 / way["num_actions"],
        "num_groups": dict(way["num_groups"]),
        "trusted": trusted,
        "controls": controls,
        "tests": tests,
    }


def _judged_control(control: Mapping[str, Any], alpha: float) -> dict[str, Any]:
    score = control["score"]
    positive = control["name"] != CONTROLS[-1]
    found = as_expected = None
    if score is not None:
        hits = [score[f"p_{measure}"] <= alpha for measure in MEASURES]
        found = all(hits) if positive else any(hits)
        as_expected = found == positive
    return {
        "name": control["name"],
        "score": score,
        "found": found,
        "as_expected": as_expected,
        "reason": "" if score is not None else control["reason"],
    }


def _status(
    test: Mapping[str, Any],
    p_adjusted: Mapping[str, float] | None,
    astray: Sequence[str],
    least: float,
    protocol: BatteryProtocol,
) -> tuple[str, str]:
    if p_adjusted is None:
        return "not_run", test["reason"]
    if test["score"]["identical"]:
        return (
            "inconclusive",
            "Scores are identical within every group, like those of a classifier that cannot distinguish actions.",
        )
    if astray:
        return "inconclusive", f"The control `{astray[0]}` did not come out as it must."
    if least > protocol.alpha:
        return "inconclusive", f"The permutations reach an adjusted p of {least:.2g} at best."
    measure, smallest = min(p_adjusted.items(), key=lambda item: item[1])
    if smallest <= protocol.alpha:
        return "fail", f"`{measure}` has adjusted p {smallest:.2g}, at most {protocol.alpha:g}."
    return "pass", f"No adjusted p is at most {protocol.alpha:g}; the smallest is {smallest:.2g}."
