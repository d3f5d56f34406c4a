"""The multiplier of a violation: a knapsack over training groups under one budget.

With predicted gains ``g`` and probabilities ``p`` of the interventions ``a`` of ``N`` groups::

    max sum g_ga x_ga     such that   sum p_ga x_ga <= alpha N,   sum_a x_ga <= 1,   x >= 0

At a multiplier ``lambda`` of a violation a group takes ``argmax_a g_ga - lambda p_ga``, 0 for nominal, and of equal
ones that of the least ``p``. What all groups take together, ``P(lambda)``, is a falling step function, and the dual
multiplier is::

    lambda* = min { lambda >= 0 : P(lambda) <= (alpha + 1e-9) N }

where the dual of the linear program is an interval, its lower end. A group's takings go along the upper concave
envelope of its points ``(p, g)`` and ``(0, 0)``, whose slopes fall; so the edges of all envelopes by falling slope
fill the budget, and the first that does not fit has ``lambda*`` as its slope. Sums of millions of edges round by
less than the 1e-9, so a budget that is used up exactly, as by equal probabilities, is used up on every processor.

Source: Dantzig 1957 (the continuous knapsack); the use is this project's choice.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["dual_multiplier"]

Array = NDArray[np.float64]

_TIE = 1e-9
"""Violations per group by which a budget may be exceeded."""


def dual_multiplier(gains: Array, probabilities: Array, *, alpha: float) -> float:
    """Utility per expected violation, at least 0; 0 where the budget is not used up.

    Args:
        gains: Predicted gains of interventions over nominal ``[groups, interventions]``.
        probabilities: Of a violation, of the same shape.
        alpha: Violations allowed per group.

    Raises:
        ValueError: Shapes differ, a gain is not finite, a probability is not in 0 .. 1, or `alpha` is below 0.
    """
    if gains.shape != probabilities.shape or gains.ndim != 2:
        raise ValueError(
            f"gains {list(gains.shape)} and probabilities {list(probabilities.shape)} are not both "
            "[groups, interventions]"
        )
    if not (np.isfinite(gains).all() and ((probabilities >= 0) & (probabilities <= 1)).all() and alpha >= 0):
        raise ValueError(f"gains are finite numbers, probabilities in 0 .. 1, and alpha is at least 0, not {alpha!r}")
    slopes, widths = _edges(gains, probabilities)
    order = np.argsort(-slopes, kind="stable")
    beyond = np.flatnonzero(np.cumsum(widths[order]) > (alpha + _TIE) * len(gains))
    return float(slopes[order[beyond[0]]]) if beyond.size else 0.0


def _edges(gains: Array, probabilities: Array) -> tuple[Array, Array]:
    """Slopes and widths in ``p`` of the rising edges of all envelopes, each ``[edges]``."""
    free = np.where(probabilities == 0, gains, 0.0)
    p, g = np.zeros((len(gains), 1)), free.max(axis=1, initial=0.0, keepdims=True)
    slopes, widths = [np.empty(0)], [np.empty(0)]
    while True:
        rising = (probabilities > p) & (gains > g)
        if not rising.any():
            return np.concatenate(slopes), np.concatenate(widths)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            steepness = np.where(rising, (gains - g) / (probabilities - p), -np.inf)
        # The steepest point that rises is the next corner; a group without one stays where it is.
        corner = steepness.argmax(axis=1, keepdims=True)
        goes = rising.any(axis=1)
        slopes.append(np.take_along_axis(steepness, corner, axis=1)[goes, 0])
        widths.append((np.take_along_axis(probabilities, corner, axis=1) - p)[goes, 0])
        p[goes] = np.take_along_axis(probabilities, corner, axis=1)[goes]
        g[goes] = np.take_along_axis(gains, corner, axis=1)[goes]
