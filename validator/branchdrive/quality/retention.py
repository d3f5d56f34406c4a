"""Retention: the share of replay pairs and of complete banks that pass, with group-bootstrap intervals.

For the ``G`` groups of a partition with ``n_g`` counted pairs, of which ``p_g`` pass::

    pairs: sum_g p_g / sum_g n_g            banks: sum_g [p_g = n_g] / G

An interval is the 2.5 and 97.5 % percentile (linear) over 2,000 resamples of ``G`` groups, drawn with replacement,
a ratio of integer sums in each; both units share the resamples. Groups are drawn by their place in the ascending
order of ``(p, n)``, so the order in which they come decides nothing, and each partition has a stream of its own,
so the presence of another one changes no interval.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage" (predeclared targets 98 % of pairs, 90 % of
banks); a missed target is reported, never hidden.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.statistics.random_words import below, words

__all__ = ["NUM_RESAMPLES", "TARGET_SHARES", "Retention", "retention"]

NUM_RESAMPLES = 2000

TARGET_SHARES: Mapping[str, float] = MappingProxyType({"pair": 0.98, "bank": 0.90})
"""Predeclared least shares by unit."""

_PERCENTILES = (0.025, 0.975)
_DRAWN_AT_ONCE = 2**18


class Retention(NamedTuple):
    """Retention of one unit in one partition.

    Attributes:
        partition: Name of the partition.
        unit: ``pair`` or ``bank``.
        num_groups: Groups of the partition.
        num_passed: Units that pass.
        num_units: Units that were counted.
        share: ``num_passed / num_units``; ``None`` where nothing was counted.
        low: Lower end of the interval; ``None`` where nothing was counted.
        high: Upper end of the interval; ``None`` where nothing was counted.
        target: Predeclared least share.
    """

    partition: str
    unit: str
    num_groups: int
    num_passed: int
    num_units: int
    share: float | None
    low: float | None
    high: float | None
    target: float

    @property
    def met(self) -> bool | None:
        """Whether the share reaches the target; ``None`` where nothing was counted, which is no pass."""
        return None if self.share is None else self.share >= self.target


def retention(
    counts: ArrayLike, partition_of: Sequence[str], *, partitions: Sequence[str], seed: int
) -> tuple[Retention, ...]:
    """Retention of pairs and banks in each of `partitions`, in their order, pairs first; groups in any order.

    Args:
        counts: Pairs that pass, and pairs that count ``[groups, 2]``.
        partition_of: Partition of each group ``[groups]``; groups of other partitions are left out.
        partitions: Partitions to report, those without a group included.
        seed: Part of the key, in ``[0, 2^64)``.

    Raises:
        ValueError: Shapes do not match, a group counts no pair, or the seed does not fit the key.
    """
    rows = np.asarray(counts, np.int64)
    if rows.shape != (len(partition_of), 2):
        raise ValueError(f"`counts` {list(rows.shape)} and {len(partition_of)} partitions do not match: [groups, 2]")
    if not rows[:, 1].all():
        raise ValueError("a group counts no pair; leave it out")
    if not 0 <= seed < 1 << 64:
        raise ValueError(f"`seed` is {seed}, not in [0, 2^64)")
    home = np.asarray(partition_of, np.str_)
    return tuple(found for name in partitions for found in _of_partition(rows[home == name], name, seed))


def _of_partition(rows: NDArray[np.int64], name: str, seed: int) -> list[Retention]:
    """Retention of groups with rows (pairs passed, pairs counted), ``[groups, 2]``."""
    size = len(rows)
    if not size:
        return [Retention(name, unit, 0, 0, 0, None, None, None, target) for unit, target in TARGET_SHARES.items()]
    pairs = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
    banks = np.stack([pairs[:, 0] == pairs[:, 1], np.ones(size, np.bool_)], axis=1).astype(np.int64)
    sums = _resampled_sums(np.concatenate([pairs, banks], axis=1), f"fidelity/retention/{name}", seed)
    found = []
    for column, (unit, target) in enumerate(TARGET_SHARES.items()):
        num_passed, num_units = (pairs, banks)[column].sum(axis=0).tolist()
        low, high = np.quantile(sums[:, 2 * column] / sums[:, 2 * column + 1], _PERCENTILES).tolist()
        found.append(Retention(name, unit, size, num_passed, num_units, num_passed / num_units, low, high, target))
    return found


def _resampled_sums(amounts: NDArray[np.int64], stream: str, seed: int) -> NDArray[np.int64]:
    """Sums of amounts ``[groups, columns]`` over the groups of every resample, ``[resamples, columns]``."""
    size = len(amounts)
    num_rows = max(1, _DRAWN_AT_ONCE // size)
    sums = []
    for start in range(0, NUM_RESAMPLES, num_rows):
        drawn = below(words(seed, stream, min(num_rows, NUM_RESAMPLES - start), size, first_row=start), size)
        sums.append(amounts[drawn].sum(axis=1))
    return np.concatenate(sums)
