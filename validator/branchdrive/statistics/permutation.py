"""Permutations of action labels within groups, their p-values and critical values.

Under the null hypothesis the rows of a group are exchangeable over actions. A permutation gives
action ``a`` of group ``g`` the row ``pi_g(a)``, every ``pi_g`` uniform and independent, and with ``B``
permutations of a statistic ``T`` that is large under leakage::

    p = (1 + #{b : T*_b >= T}) / (B + 1)

Permutation ``b`` is row ``b`` of a stream, a function of seed and ``b`` alone, so neither chunks nor earlier
draws change it. All statistics share the permutations.

Who draws the first ``n`` of them again sees whether a stated p-value fits: of ``B`` permutations ``k`` reach the
statistic, by the statement, and of the first ``n`` of them ``c`` do. Permutations are exchangeable, so ``c`` is
hypergeometric: ``P(c) = C(k, c) C(B - k, n - c) / C(B, n)``. With ``n = B`` only ``c = k`` is possible.

Source: Phipson and Smyth 2010 (p-value); the design randomises actions within groups,
paper, "Intervention Policy Bank".
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "LEAST_TAIL", "TIE", "critical_rank", "critical_value", "identity", "is_plausible", "labels", "p_value", "reaching",
]  # fmt: skip

Array = NDArray[np.float64]

TIE = 1e-9
"""Statistics that differ by no more, relative to the observed one, are equal."""

_TIE_ABSOLUTE = 1e-12
"""So are those that differ by no more: rounding of sums that cancel."""

LEAST_TAIL = 1e-9
"""Two-sided tail below which a count contradicts a stated p-value."""

_SLACK = 1
"""Permutations that the last bits of another machine may move across a statistic."""


def identity(num_groups: int, num_actions: int) -> NDArray[np.intp]:
    """The labels as recorded, ``[1, groups, actions]``."""
    return np.broadcast_to(np.arange(num_actions), (1, num_groups, num_actions))


def labels(rows: NDArray[np.intp]) -> NDArray[np.float32]:
    """Permutations as a matrix that sums rows by action, ``[permutations * actions, groups * actions]``.

    Its product with a table ``[groups * actions, columns]`` holds, for every permutation and action,
    the sum of the rows that the action gets. Where the table holds integers of at most
    `branchdrive.leakage.table.step_limit`, these sums are exact in any order.
    """
    num_permutations, num_groups, num_actions = rows.shape
    matrix = np.zeros((num_permutations * num_actions, num_groups * num_actions), np.float32)
    line = np.arange(num_permutations * num_actions).reshape(num_permutations, 1, num_actions)
    place = line * matrix.shape[1] + np.arange(num_groups)[:, None] * num_actions + rows
    matrix.reshape(-1)[place.reshape(-1)] = 1.0
    return matrix


def reaching(null: Array, observed: Array | float) -> NDArray[np.intp]:
    """How many of a null distribution ``[B, ..]`` reach what was observed ``[..]``, equal ones included."""
    tie = TIE * np.abs(observed) + _TIE_ABSOLUTE
    return np.asarray(np.count_nonzero(null >= observed - tie, axis=0))


def p_value(observed: float, null: Array) -> float:
    """``(1 + #{T* >= T}) / (B + 1)`` for a null distribution ``[B]``."""
    return float((1 + reaching(null, observed)) / (len(null) + 1))


def critical_rank(num_permutations: int, alpha: float) -> int:
    """``k = floor(alpha (B + 1))``: the critical value is the ``k``-th largest of ``B`` permutations."""
    return int(np.floor(alpha * (num_permutations + 1) * (1 + TIE)))


def critical_value(null: Array, alpha: float) -> float:
    """Value that a statistic must exceed for ``p <= alpha``; ``inf`` where no value can.

    With ``k = floor(alpha (B + 1))`` it is the ``k``-th largest of the null distribution ``[B]``.
    """
    rank = critical_rank(len(null), alpha)
    if rank == 0:
        return np.inf
    if rank > len(null):
        return -np.inf
    return float(np.partition(null, -rank)[-rank])


def is_plausible(reached: int, drawn: int, p: float, num_permutations: int) -> bool:
    """Whether `reached` of the first `drawn` permutations fit ``p = (1 + k) / (B + 1)``, with one permutation to spare.

    Args:
        reached: Permutations drawn that reach the statistic, ``c``.
        drawn: Permutations drawn, ``n``.
        p: As stated.
        num_permutations: Permutations that `p` was counted over, ``B``.
    """
    whole = round(p * (num_permutations + 1)) - 1
    counts = range(max(0, whole - _SLACK), min(num_permutations, whole + _SLACK) + 1)
    return any(_two_sided(reached, drawn, k, num_permutations) >= LEAST_TAIL for k in counts)


def _two_sided(c: int, n: int, k: int, total: int) -> float:
    """Twice the smaller of both tails of the hypergeometric distribution, each with `c` itself.

    Either tail holds ``P(c)``, so where that alone is large enough no tail is summed up.
    """
    least, most = max(0, n - (total - k)), min(n, k)
    if not least <= c <= most:
        return 0.0
    if (alone := 2 * _probability(c, n, k, total)) >= LEAST_TAIL:
        return alone
    below = math.fsum(_probability(x, n, k, total) for x in range(least, c + 1))
    above = math.fsum(_probability(x, n, k, total) for x in range(c, most + 1))
    return 2 * min(below, above)


def _probability(c: int, n: int, k: int, total: int) -> float:
    return math.exp(_log_choose(k, c) + _log_choose(total - k, n - c) - _log_choose(total, n))


def _log_choose(n: int, k: int) -> float:
    return math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)
