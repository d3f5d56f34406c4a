"""Permutations of action labels within groups, their p-values and critical values.

Under the null hypothesis the rows of a group are exchangeable over actions. A permutation gives
action ``a`` of group ``g`` the row ``pi_g(a)``, every ``pi_g`` uniform and independent, and with ``B``
permutations of a statistic ``T`` that is large under leakage::

    p = (1 + #{b : T*_b >= T}) / (B + 1)

Permutation ``b`` is a function of seed and ``b`` alone (Philox, its counter placed by ``b``), so neither
chunks nor earlier draws change it. All statistics share the permutations.

Source: Phipson and Smyth 2010 (p-value); the design randomises actions within groups, paper III-D.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BOOTSTRAP",
    "FREQUENCIES",
    "HELD_OUT",
    "PERMUTATIONS",
    "RANDOM_LABELS",
    "REPLICATES",
    "REPLICATE_PLACES",
    "TIE",
    "TRAINING",
    "critical_rank",
    "critical_value",
    "draw",
    "generator",
    "identity",
    "labels",
    "p_value",
]

Array = NDArray[np.float64]

PERMUTATIONS, FREQUENCIES, REPLICATES, REPLICATE_PLACES, HELD_OUT, BOOTSTRAP, RANDOM_LABELS, TRAINING = range(8)
"""Streams of randomness under one seed."""

TIE = 1e-9
"""Statistics that differ by no more, relative to the observed one, are equal."""

_WORDS_PER_BLOCK = 4
_SEEDS = 2**64


def generator(seed: int, stream: int, block: int = 0) -> np.random.Philox:
    """Counter-based bit generator of one stream, placed at `block`.

    Raises:
        ValueError: `seed` is negative or needs more than 64 bits.
    """
    if not 0 <= seed < _SEEDS:
        raise ValueError(f"`seed` is {seed!r}, not in 0 .. 2**64 - 1")
    return np.random.Philox(key=np.array([seed, stream], np.uint64), counter=block)


def draw(
    start: int, stop: int, num_groups: int, num_actions: int, *, seed: int, stream: int = PERMUTATIONS
) -> NDArray[np.intp]:
    """Permutations ``start .. stop - 1`` as ``[permutations, groups, actions]``: the row that each action gets."""
    blocks = -(-num_groups * num_actions // _WORDS_PER_BLOCK)
    words = generator(seed, stream, start * blocks).random_raw((stop - start) * blocks * _WORDS_PER_BLOCK)
    keys = words.reshape(stop - start, -1)[:, : num_groups * num_actions].reshape(-1, num_groups, num_actions)
    # Sorting random words that carry their own index in the lowest bits is quicker than `argsort`.
    mask = np.uint64((1 << (num_actions - 1).bit_length()) - 1)
    return (np.sort((keys & ~mask) | np.arange(num_actions, dtype=np.uint64), axis=2) & mask).astype(np.intp)


def identity(num_groups: int, num_actions: int) -> NDArray[np.intp]:
    """The labels as recorded, ``[1, groups, actions]``."""
    return np.broadcast_to(np.arange(num_actions), (1, num_groups, num_actions))


def labels(rows: NDArray[np.intp]) -> NDArray[np.float32]:
    """Permutations as a matrix that sums rows by action, ``[permutations * actions, groups * actions]``.

    Its product with a table ``[groups * actions, columns]`` holds, for every permutation and action,
    the sum of the rows that the action gets. Where the table holds integers of at most
    `branchdrive.derive.leakage.table.step_limit`, these sums are exact in any order.
    """
    num_permutations, num_groups, num_actions = rows.shape
    matrix = np.zeros((num_permutations * num_actions, num_groups * num_actions), np.float32)
    line = np.arange(num_permutations * num_actions).reshape(num_permutations, 1, num_actions)
    place = line * matrix.shape[1] + np.arange(num_groups)[:, None] * num_actions + rows
    matrix.reshape(-1)[place.reshape(-1)] = 1.0
    return matrix


def p_value(observed: float, null: Array) -> float:
    """``(1 + #{T* >= T}) / (B + 1)`` for a null distribution ``[B]``."""
    return float((1 + np.count_nonzero(null >= observed - TIE * abs(observed))) / (len(null) + 1))


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
