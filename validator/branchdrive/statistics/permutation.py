"""Permutations of action labels within groups, their p-values and critical values.

Under the null hypothesis the rows of a group are exchangeable over actions. A permutation gives
action ``a`` of group ``g`` the row ``pi_g(a)``, every ``pi_g`` uniform and independent, and with ``B``
permutations of a statistic ``T`` that is large under leakage::

    p = (1 + #{b : T*_b >= T}) / (B + 1)

Permutation ``b`` is row ``b`` of a stream, a function of seed and ``b`` alone, so neither chunks nor earlier
draws change it. All statistics share the permutations.

Source: Phipson and Smyth 2010 (p-value); the design randomises actions within groups, paper III-D.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.statistics.stream import orders, words

__all__ = [
    "PERMUTATIONS", "TIE", "critical_rank", "critical_value", "draw", "identity", "labels", "p_value", "reaching",
]  # fmt: skip

Array = NDArray[np.float64]

PERMUTATIONS = "leakage/permutations"
"""Stream of the permutations of the gate."""

TIE = 1e-9
"""Statistics that differ by no more, relative to the observed one, are equal."""

_TIE_ABSOLUTE = 1e-12
"""So are those that differ by no more: rounding of sums that cancel."""


def draw(
    start: int, stop: int, num_groups: int, num_actions: int, *, seed: int, stream: str = PERMUTATIONS
) -> NDArray[np.intp]:
    """Permutations ``start .. stop - 1`` as ``[permutations, groups, actions]``: the row that each action gets.

    Raises:
        ValueError: `seed` is negative or needs more than 64 bits.
    """
    drawn = words(seed, stream, stop - start, num_groups * num_actions, first_row=start)
    return orders(drawn.reshape(-1, num_actions)).reshape(-1, num_groups, num_actions)


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
