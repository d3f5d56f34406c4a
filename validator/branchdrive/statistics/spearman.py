"""Spearman's rank correlation: within a bank, and pooled over groups that count several times or not at all.

Twice a midrank less its mean is ``r_i = sum_j c_j sign(x_i - x_j)``, where point ``j`` counts ``c_j`` times, and

    rho = sum_i c_i r_i(x) r_i(y) / sqrt(sum_i c_i r_i(x)^2  sum_i c_i r_i(y)^2)

Going up the distinct values ``u`` of ``x``, each with the count ``t_u``, and with ``n = sum t``::

    r_u = t_1 + .. + t_{u-1} - (t_{u+1} + .. + t_U)        sum_i c_i r_i^2 = (n^3 - sum_u t_u^3) / 3

All sums are of whole numbers, exact in float64 below ``2^53``, so neither the order of the groups nor that of the
candidates changes a bit. The correlation is NaN where ``x`` or ``y`` is constant.

Source: Spearman 1904; Kendall 1945 (ties).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from branchdrive.statistics.bootstrap import Design

__all__ = ["bank_spearman", "pooled_spearman"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]

_NUM_CELLS = 1 << 22
"""Cells of the largest table: 32 MiB of ranks."""


def bank_spearman(truth: Array, predicted: Array, available: Mask) -> Array:
    """Correlation over the available candidates of each group: three ``[N, A, K]`` to ``[N, K]``."""
    ranks_x, ranks_y = _bank_ranks(predicted, available), _bank_ranks(truth, available)
    square = (ranks_x**2).sum(axis=1) * (ranks_y**2).sum(axis=1)
    return _ratio((ranks_x * ranks_y).sum(axis=1), np.sqrt(square))


def _bank_ranks(values: Array, available: Mask) -> Array:
    pairs = available[:, :, None] & available[:, None, :]
    return np.asarray((np.sign(values[:, :, None] - values[:, None, :]) * pairs).sum(axis=2))


def pooled_spearman(truth: Array, predicted: Array, available: Mask, counts: Array | Design) -> Array:
    """Correlation over the available candidates of all groups, each group as often as it counts.

    Args:
        truth: ``[N, A, K]``.
        predicted: ``[P, N, A, K]``, several predictions of the same truth.
        available: ``[N, A, K]``.
        counts: ``[R, N]``, whole numbers.

    Returns:
        ``[P, R, K]``.
    """
    num_points = int(available.sum(axis=(0, 1)).max(initial=1))
    found = np.full((len(predicted), len(counts), truth.shape[2]), np.nan)
    size = max(1, _NUM_CELLS // max(num_points, 1))
    table = np.empty((num_points, min(size, len(counts))))
    for start in range(0, len(counts), size):
        part = slice(start, start + size)
        by_group = np.ascontiguousarray(counts[part].T)
        for k in range(truth.shape[2]):
            points = available[..., k]
            home = np.nonzero(points)[0]
            total = by_group[home].sum(axis=0)
            ranks = table[: len(home), : len(total)]
            square_y = _fill_ranks(ranks, truth[..., k][points], home, by_group, total)
            for p, values in enumerate(predicted[..., k]):
                product, square_x = _product(values[points], home, by_group, total, ranks)
                found[p, part, k] = _ratio(product, np.sqrt(square_x * square_y))
    return found


def _fill_ranks(ranks: Array, values: Array, home: Index, by_group: Array, total: Array) -> Array:
    """Write ``c_i r_i`` of points ``[n]`` to `ranks` ``[n, R]``; returns ``sum_i c_i r_i^2`` ``[R]``."""
    low, cubes = -total, np.zeros_like(total)
    for members in _tied(values):
        counts = by_group[home[members]]
        count = counts.sum(axis=0)
        rank = low + count
        ranks[members] = counts * rank
        cubes += count**3
        low = rank + count
    return np.asarray((total**3 - cubes) / 3)


def _product(values: Array, home: Index, by_group: Array, total: Array, ranks: Array) -> tuple[Array, Array]:
    """``sum_i c_i r_i(x) r_i(y)`` and ``sum_i c_i r_i(x)^2``, both ``[R]``, for ranks ``c_i r_i(y)`` ``[n, R]``."""
    low, product, cubes = -total, np.zeros_like(total), np.zeros_like(total)
    rank, term = np.empty_like(total), np.empty_like(total)
    alone = []
    for members in _tied(values):
        if len(members) == 1:
            i = members[0]
            count, weight = by_group[home[i]], ranks[i]
            alone.append(i)
        else:
            count, weight = by_group[home[members]].sum(axis=0), ranks[members].sum(axis=0)
            cubes += count**3
        # In place: this loop over points is where the time of a bootstrap goes.
        np.add(low, count, out=rank)
        np.multiply(rank, weight, out=term)
        np.add(product, term, out=product)
        np.add(rank, count, out=low)
    cubes += np.bincount(home[np.array(alone, np.intp)], minlength=len(by_group)) @ by_group**3
    return product, (total**3 - cubes) / 3


def _tied(values: Array) -> list[Index]:
    """Places of equal values, in ascending order of the values."""
    order = np.argsort(values, kind="stable")
    starts = [0, *(np.flatnonzero(np.diff(values[order])) + 1).tolist(), len(order)]
    return [order[start:stop] for start, stop in pairwise(starts) if start < stop]


def _ratio(numerator: Array, denominator: Array) -> Array:
    defined = denominator > 0
    return np.asarray(np.divide(numerator, denominator, out=np.full(numerator.shape, np.nan), where=defined))
