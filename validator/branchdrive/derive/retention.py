"""Retention: the share of replay pairs and of complete banks that pass, with group-bootstrap intervals.

For the ``G`` groups of a partition with ``n_g`` counted pairs, of which ``p_g`` pass::

    pairs: sum_g p_g / sum_g n_g            banks: sum_g [p_g = n_g] / G

An interval is the 2.5 and 97.5 % percentile (linear) over 2,000 resamples of whole groups, multinomial
with ``G`` draws, a ratio of sums in each; both units share the resamples. Groups with equal ``(n, p)`` are
interchangeable, so the draw is made over the distinct pairs in ascending order, with their frequencies:
the same law, and the order of the groups decides nothing.

The generator is Philox with the 128-bit key ``(seed, first 8 bytes of the SHA-256 of the partition's
name, little-endian)``, so the presence of another partition changes no interval.

Source: paper V-B (predeclared targets 98 % of pairs, 90 % of banks); a missed target is reported, never hidden.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["NUM_RESAMPLES", "TARGET_SHARES", "Retention", "retention"]

NUM_RESAMPLES = 2000

TARGET_SHARES: Mapping[str, float] = MappingProxyType({"pair": 0.98, "bank": 0.90})
"""Predeclared least shares by unit."""

_PERCENTILES = (0.025, 0.975)


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
    passed: ArrayLike,
    partition_of: Sequence[str],
    *,
    partitions: Sequence[str],
    seed: int,
    counted: ArrayLike | None = None,
) -> tuple[Retention, ...]:
    """Retention of pairs and banks in each of `partitions`, in their order, pairs first.

    Args:
        passed: ``[groups, pairs]``, whether a pair passes.
        partition_of: Partition of each group ``[groups]``; groups of other partitions are left out.
        partitions: Partitions to report, those without a group included.
        seed: Part of the key, in ``[0, 2^64)``.
        counted: ``[groups, pairs]``, the pairs that count; all of them by default. Every group counts one.

    Raises:
        ValueError: Shapes do not match, a group counts no pair, or the seed does not fit the key.
    """
    passes = np.asarray(passed, np.bool_)
    counts = np.ones_like(passes) if counted is None else np.asarray(counted, np.bool_)
    if passes.ndim != 2 or counts.shape != passes.shape or len(partition_of) != len(passes):
        raise ValueError(
            f"`passed` {list(passes.shape)}, `counted` {list(counts.shape)} and {len(partition_of)} partitions "
            "do not match: [groups, pairs] and [groups]"
        )
    if not counts.any(axis=1).all():
        raise ValueError("a group counts no pair; leave it out")
    if not 0 <= seed < 1 << 64:
        raise ValueError(f"`seed` is {seed}, not in [0, 2^64)")
    rows = np.stack([(passes & counts).sum(axis=1), counts.sum(axis=1)], axis=1)
    home = np.asarray(partition_of, np.str_)
    return tuple(found for name in partitions for found in _of_partition(rows[home == name], name, seed))


def _of_partition(rows: NDArray[np.int64], name: str, seed: int) -> list[Retention]:
    """Retention of groups with rows (pairs passed, pairs counted), ``[groups, 2]``."""
    kinds, frequency = np.unique(rows, axis=0, return_counts=True)
    banks = np.stack([kinds[:, 0] == kinds[:, 1], np.ones(len(kinds), np.bool_)], axis=1).astype(np.int64)
    if not len(rows):
        return [Retention(name, unit, 0, 0, 0, None, None, None, target) for unit, target in TARGET_SHARES.items()]
    draws = _generator(seed, name).multinomial(len(rows), frequency / len(rows), size=NUM_RESAMPLES)
    found = []
    for (unit, target), amounts in zip(TARGET_SHARES.items(), (kinds, banks), strict=True):
        num_passed, num_units = (frequency @ amounts).tolist()
        resampled = draws @ amounts
        low, high = np.quantile(resampled[:, 0] / resampled[:, 1], _PERCENTILES).tolist()
        found.append(Retention(name, unit, len(rows), num_passed, num_units, num_passed / num_units, low, high, target))
    return found


def _generator(seed: int, name: str) -> np.random.Generator:
    word = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
    return np.random.Generator(np.random.Philox(key=np.array([seed, word], np.uint64)))
