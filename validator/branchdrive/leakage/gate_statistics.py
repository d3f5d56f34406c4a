"""The statistics of the gate on one table, and their null distribution.

Permutations are shared: row ``b`` of the null distribution holds all statistics of permutation ``b``. They are
worked off in chunks; a chunk holds the label matrix and what one statistic needs beside it. Four of them judge the
columns of the table, and two, of `scan`, ranks of features and of recorded streams.

Source: this project's choice, on measured power: each of them finds what another misses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.leakage.draw import Draw, Kept, KeptHere, drawn_here, ranges_of
from branchdrive.leakage.protocol import STATISTICS, GateProtocol
from branchdrive.leakage.scan import Concordance, Interaction, Layout, Ranks
from branchdrive.leakage.statistic import Hsic, MaxT, Ridge, frequencies, median_distance
from branchdrive.leakage.streams import Streams
from branchdrive.leakage.table import Column, Table, checked, tabulate
from branchdrive.statistics.permutation import identity, labels
from branchdrive.statistics.random_words import group_orders

__all__ = ["GateStatistics", "Reference", "chunk_length", "null_distribution"]

Array = NDArray[np.float64]

_PERMUTATIONS = "leakage/permutations"


def chunk_length(num_groups: int, num_actions: int, scratch_columns: int, scratch_bytes: int) -> int:
    """Permutations of one chunk, so that it occupies at most `scratch_bytes`; at least 1.

    For every permutation: the label matrix in float32, its places and sorted words in 64 bits, and
    `scratch_columns` float64 numbers for every action.
    """
    matrix = num_actions * num_groups * num_actions * 4
    places = 6 * num_groups * num_actions * 8
    return max(1, scratch_bytes // (matrix + places + num_actions * scratch_columns * 8))


class Reference(NamedTuple):
    """What statistics take from the data once, so that changed data are judged by the same yardstick.

    Attributes:
        columns: Columns of the table.
        sd: Robust standard deviation of every feature ``[features]``, in the feature's unit.
        bandwidth: Of the kernel, in standard deviations.
        omega: Frequencies ``[columns, frequencies]`` of bandwidth 1.
        layout: How features belong together.
    """

    columns: tuple[Column, ...]
    sd: Array
    bandwidth: float
    omega: Array
    layout: Layout


@dataclass(frozen=True, eq=False)
class GateStatistics:
    """Statistics ready for any labels.

    Attributes:
        table: Columns that they judge.
        reference: What they took from the data once.
        rank_max_t: Largest standardised mean of ranks.
        max_t: Largest standardised mean of values.
        hsic: Kernel criterion.
        ridge: Cross-fitted ridge.
        concordance: Largest concordance of groups, of features and streams.
        interaction: Largest dependence of products of commands.
    """

    table: Table
    reference: Reference
    rank_max_t: MaxT
    max_t: MaxT
    hsic: Hsic
    ridge: Ridge
    concordance: Concordance
    interaction: Interaction

    @classmethod
    def of(
        cls,
        features: ArrayLike,
        protocol: GateProtocol,
        *,
        seed: int,
        layout: Layout | None = None,
        streams: Streams | None = None,
    ) -> GateStatistics:
        """Statistics of features ``[groups, actions, features]``; folds are runs of consecutive groups.

        Args:
            features: Values.
            protocol: Numbers of the gate.
            seed: Of the frequencies.
            layout: How features belong together; None keeps them apart.
            streams: Recorded columns of the same groups and actions; None is none.

        Raises:
            ValueError: The shape is wrong, or there are fewer groups than folds.
        """
        features = checked(features)
        layout = layout or Layout.apart(features.shape[2])
        table = tabulate(features)
        steps = table.steps.reshape(table.num_groups, table.num_actions, table.steps.shape[1]).astype(np.float64)
        bandwidth = median_distance(steps, unit=table.step) if protocol.bandwidth is None else protocol.bandwidth
        omega = frequencies(len(table.columns), protocol.num_frequencies, seed=seed)
        reference = Reference(table.columns, table.sd, bandwidth, omega, layout)
        return cls._on(table, reference, protocol, Ranks.of(features, layout, streams))

    @classmethod
    def like(cls, reference: Reference, features: ArrayLike, protocol: GateProtocol) -> GateStatistics:
        """Statistics of other features ``[groups, actions, features]`` by the yardstick of `reference`, no streams.

        Raises:
            ValueError: The shape is wrong, or there are fewer groups than folds.
        """
        table = tabulate(features, columns=reference.columns, sd=reference.sd)
        return cls._on(table, reference, protocol, Ranks.of(checked(features), reference.layout, None))

    @classmethod
    def _on(cls, table: Table, reference: Reference, protocol: GateProtocol, ranks: Ranks) -> GateStatistics:
        return cls(
            table,
            reference,
            MaxT.of(table.ranks, table.num_actions),
            MaxT.of(table.steps, table.num_actions),
            Hsic.of(table, reference.omega, reference.bandwidth),
            Ridge.of(table, protocol.num_folds, protocol.penalty),
            Concordance.of(ranks, protocol.subsets),
            Interaction.of(ranks, reference.layout.commands),
        )

    def observed(self) -> Array:
        """Statistics of the labels as recorded, in the order of `STATISTICS`: ``[statistics]``."""
        rows = identity(self.table.num_groups, self.table.num_actions)
        return np.asarray(self._statistics(rows)[0])

    def null(
        self, num_permutations: int, *, seed: int, scratch_bytes: int, start: int = 0, draw: Draw = drawn_here
    ) -> Array:
        """Statistics of random permutations ``[permutations, statistics]``.

        Args:
            num_permutations: Number of the last, and one.
            seed: Of the permutations.
            scratch_bytes: Bound on what a chunk of them occupies.
            start: Number of the first.
            draw: How ranges of them are computed, which are of whole chunks, so that it decides no bit.
        """
        length = self.chunk_length(scratch_bytes)
        return null_distribution(KeptHere(self), num_permutations, seed=seed, length=length, start=start, draw=draw)

    def chunk_length(self, scratch_bytes: int) -> int:
        """Permutations of one chunk, so that it occupies at most `scratch_bytes`."""
        widest = max(getattr(self, name).scratch_columns for name in STATISTICS)
        return chunk_length(self.table.num_groups, self.table.num_actions, widest, scratch_bytes)

    def _statistics(self, rows: NDArray[np.intp]) -> Array:
        matrix = labels(rows)
        by_fold = self.ridge.sums(matrix)
        found = {"max_t": self.max_t.largest(by_fold.sum(axis=0)), "ridge": self.ridge.score(by_fold)}
        del by_fold  # makes room for what the others need
        found |= {
            "rank_max_t": self.rank_max_t(matrix),
            "hsic": self.hsic(matrix),
            "concordance": self.concordance(rows, matrix),
            "interaction": self.interaction(rows),
        }
        return np.stack([found[name] for name in STATISTICS], axis=1)


def null_distribution(
    statistics: Kept[GateStatistics], num_permutations: int, *, seed: int, length: int, draw: Draw, start: int = 0
) -> Array:
    """Statistics of random permutations ``[permutations, statistics]``, in ranges of whole chunks of a length."""
    ranges = [range(r.start + start, r.stop + start) for r in ranges_of(num_permutations - start, length)]
    found = draw(_null_of, (statistics, seed, length), ranges)
    return np.concatenate([np.empty((0, len(STATISTICS))), *found])


def _null_of(subject: tuple[Kept[GateStatistics], int, int], numbers: range) -> Array:
    """Statistics of permutations, chunk by chunk ``[permutations, statistics]``."""
    kept, seed, length = subject
    statistics = kept.value
    shape = (statistics.table.num_groups, statistics.table.num_actions)
    null = np.empty((len(numbers), len(STATISTICS)))
    for first in range(numbers.start, numbers.stop, length):
        stop = min(first + length, numbers.stop)
        rows = group_orders(seed, _PERMUTATIONS, stop - first, *shape, first_row=first)
        null[first - numbers.start : stop - numbers.start] = statistics._statistics(rows)
    return null
