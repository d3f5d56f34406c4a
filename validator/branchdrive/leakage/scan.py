"""Two statistics of a leakage audit that look for codes: concordance of groups, and products of commands.

**Concordance** asks whether groups put their actions in the same order, in any column, and over which groups. With
centred ranks ``r_{g,a}`` of a column, ``q_g = sum_a r_{g,a}^2``, the sum ``S_a`` of an action and ``k = actions - 1``::

    W = sum_a S_a^2 / (sum_g sqrt(q_g))^2          n = (sum_g sqrt(q_g))^2 / sum_g q_g
    x = max(k, -k (n - 1) log(1 - W))              D = min(x - k - k log(x / k), E)              T = max D

``W`` is 1 where all groups agree, and ``n`` the number of groups that differ at all. ``x`` is nearly chi-square with
``k`` degrees of freedom, so ``D`` bounds minus twice the logarithm of its tail (Chernoff), and is comparable between
few groups and many; ``E`` is minus twice the logarithm of the chance that groups with these ties agree entirely,
which keeps columns with few distinct values from looking more surprising than they can be.

The maximum runs over columns, and over all groups as well as the tenth and the thirtieth of them in which a variable
differs most. Which these are does not depend on the labels, so that a code in few groups is seen among few.

**Interaction** asks whether the product of the signs of two commands, each against the middle of its group, tells
the action. With the sum ``M_a`` of the product of a pair over groups, its mean ``m`` over actions and its variance
``v`` under permutations::

    T = max over pairs of (actions - 1) / actions sum_a (M_a - m)^2 / v

Source: Kendall and Babington Smith 1939 (W); Chernoff 1952 (tail); the scan is this project's choice.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.leakage.inputs import GateFeature
from branchdrive.leakage.streams import Streams, ranked
from branchdrive.statistics.permutation import labels

__all__ = ["Concordance", "Interaction", "Layout", "Place", "Ranks"]

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Steps = NDArray[np.float32]

_LEAST_REST = 2.0**-20
"""Least ``1 - W`` that the logarithm is taken of."""

_DRAWN_AT_ONCE = 1 << 18
"""Ranks that are drawn before they are summed up."""


class Layout(NamedTuple):
    """How the features of a gate belong together.

    Attributes:
        variable: Number of the variable of every feature ``[features]``, from 0.
        commands: Features whose products are examined.
    """

    variable: tuple[int, ...]
    commands: tuple[int, ...]

    @classmethod
    def of(cls, features: Sequence[GateFeature]) -> Layout:
        """Times of a variable belong together; commands are the controls."""
        number: dict[tuple[str, str], int] = {}
        variable = tuple(number.setdefault((f.source, f.name), len(number)) for f in features)
        return cls(variable, tuple(i for i, f in enumerate(features) if f.source == "controls"))

    @classmethod
    def apart(cls, num_features: int) -> Layout:
        """Every feature is a variable of its own, and none a command."""
        return cls(tuple(range(num_features)), ())


class Ranks(NamedTuple):
    """Columns of the scan: features, then columns of streams.

    Attributes:
        ranks: Centred doubled ranks ``[groups, actions, columns]``.
        spread: Largest difference of two values of a group ``[groups, columns]``.
        variable: Number of the variable of every column ``[columns]``.
    """

    ranks: NDArray[np.int16]
    spread: NDArray[np.float32]
    variable: Index

    @classmethod
    def of(cls, features: Array, layout: Layout, streams: Streams | None) -> Ranks:
        """Columns of features ``[groups, actions, features]`` and of streams."""
        ranks, spread = ranked(features)
        variable = np.array(layout.variable, np.intp)
        if streams is None:
            return cls(ranks, spread, variable)
        number: dict[tuple[str, str], int] = {}
        first = int(variable.max(initial=-1)) + 1
        of_streams = [first + number.setdefault((c.table, c.name), len(number)) for c in streams.columns]
        return cls(
            np.concatenate([ranks, streams.ranks], axis=2),
            np.concatenate([spread, streams.spread], axis=1),
            np.concatenate([variable, np.array(of_streams, np.intp)]),
        )


class Place(NamedTuple):
    """Where a statistic of the scan is large.

    Attributes:
        columns: Columns, one of concordance and two of an interaction.
        num_groups: Groups that it was computed over.
        value: How large it is.
    """

    columns: tuple[int, ...]
    num_groups: int
    value: float


@dataclass(frozen=True, eq=False)
class _Part:
    """Columns of the scan over some groups.

    Attributes:
        columns: These columns.
        steps: Their ranks ``[groups * actions, columns]``.
        num_groups: Groups.
        agreed: ``(sum_g sqrt(q_g))^2`` of every column.
        num_differing: ``n`` of every column.
        largest: ``E`` of every column.
    """

    columns: Index
    steps: Steps
    num_groups: int
    agreed: Array
    num_differing: Array
    largest: Array

    @classmethod
    def of(cls, ranks: NDArray[np.int16], surprise: Array, columns: Index) -> _Part:
        """Columns ``[groups, actions, columns]``, the logarithms of their orders ``[groups, columns]``, and places."""
        squares = np.square(ranks.astype(np.float64)).sum(axis=1)
        agreed = np.square(np.sqrt(squares).sum(axis=0))
        whole = squares.sum(axis=0)
        num_differing = np.divide(agreed, whole, out=np.ones_like(agreed), where=whole > 0)
        largest = 2 * (surprise.sum(axis=0) - surprise.max(axis=0, initial=0.0))
        steps = ranks.reshape(-1, len(columns)).astype(np.float32)
        return cls(columns, steps, len(ranks), agreed, num_differing, largest)

    def sums(self, rows: Index) -> Steps:
        """``S`` of labels of the groups ``[permutations, groups, actions]``: ``[permutations, actions, columns]``."""
        num_permutations, num_groups, num_actions = rows.shape
        place = rows + num_actions * np.arange(num_groups)[:, None]
        found = np.empty((num_permutations, num_actions, len(self.columns)), np.float32)
        length = max(1, _DRAWN_AT_ONCE // (num_groups * num_actions * len(self.columns)))
        for first in range(0, num_permutations, length):
            drawn = self.steps.take(place[first : first + length], axis=0)
            drawn.sum(axis=1, out=found[first : first + length])
        return found

    def values(self, sums: Steps) -> Array:
        """``D`` of sums ``[permutations, actions, columns]``: ``[permutations, columns]``."""
        num_actions = sums.shape[1]
        square = np.zeros((len(sums), len(self.columns)))
        for action in range(num_actions):
            square += np.square(sums[:, action].astype(np.float64))
        freedom = num_actions - 1
        rest = 1.0 - np.divide(square, self.agreed, out=np.zeros_like(square), where=self.agreed > 0)
        x = -np.log(np.maximum(rest, _LEAST_REST)) * (self.num_differing - 1.0)
        x = np.maximum(x, 1.0)
        return np.asarray(np.minimum(freedom * (x - 1.0 - np.log(x)), self.largest))


@dataclass(frozen=True, eq=False)
class _Selection:
    """Parts over the first of some groups.

    Attributes:
        groups: These groups, in an order.
        parts: Each over as many of the first of them as it has.
    """

    groups: Index
    parts: tuple[_Part, ...]

    def values(self, rows: Index) -> list[Array]:
        """``D`` of every part under labels ``[permutations, all groups, actions]``."""
        own = rows[:, self.groups]
        return [part.values(part.sums(own[:, : part.num_groups])) for part in self.parts]


@dataclass(frozen=True, eq=False)
class Concordance:
    """Largest concordance of groups over columns and subsets of groups.

    Attributes:
        whole: All columns over all groups; None where these are not looked at.
        selections: Of each variable the groups in which it differs most.
    """

    whole: _Part | None
    selections: tuple[_Selection, ...]

    @classmethod
    def of(cls, table: Ranks, subsets: Sequence[int]) -> Concordance:
        """Concordance of columns that differ within a group, equal ones once, over one in `subsets` groups each."""
        kept, surprise, num_groups = _distinct(table.ranks), _surprise(table.ranks), len(table.ranks)
        is_whole = 1 in subsets and len(kept) > 0
        whole = _Part.of(table.ranks[:, :, kept], surprise[:, kept], kept) if is_whole else None
        selections = []
        sizes = [size for size in (-(-num_groups // part) for part in subsets if part > 1) if 1 < size < num_groups]
        for variable in np.unique(table.variable[kept]).tolist() if sizes else []:
            columns = kept[table.variable[kept] == variable]
            groups = _by_spread(table.spread[:, columns])[: max(sizes)]
            ranks, logarithms = table.ranks[groups][:, :, columns], surprise[groups][:, columns]
            parts = [_Part.of(ranks[:size], logarithms[:size], columns) for size in sizes]
            selections.append(_Selection(groups, tuple(parts)))
        return cls(whole, tuple(selections))

    @property
    def scratch_columns(self) -> int:
        """Float64 numbers that a permutation needs for every action."""
        parts = [part for selection in self.selections for part in selection.parts]
        return max((len(part.columns) for part in (*parts, self.whole) if part is not None), default=0)

    def __call__(self, rows: Index, matrix: Steps) -> Array:
        """``T`` of every permutation ``[permutations]``.

        Args:
            rows: Labels ``[permutations, groups, actions]``.
            matrix: The same as `labels` gives them.
        """
        largest = np.zeros(len(rows))
        for _, values in self._values(rows, matrix):
            np.maximum(largest, values.max(axis=1), out=largest)
        return largest

    def _values(self, rows: Index, matrix: Steps) -> Iterator[tuple[_Part, Array]]:
        """Every part with its ``D``, ``[permutations, columns]``; a matrix is quick where most groups take part."""
        if self.whole is not None:
            sums = (matrix @ self.whole.steps).reshape(len(rows), rows.shape[2], len(self.whole.columns))
            yield self.whole, self.whole.values(sums)
        for selection in self.selections:
            yield from zip(selection.parts, selection.values(rows), strict=True)

    def places(self, rows: Index, num_named: int) -> list[Place]:
        """The largest ``D`` of one labelling ``[1, groups, actions]``, every column once, largest first."""
        found: dict[int, Place] = {}
        for part, values in self._values(rows, labels(rows)):
            for column, value in zip(part.columns.tolist(), values[0].tolist(), strict=True):
                if column not in found or value > found[column].value:
                    found[column] = Place((column,), part.num_groups, value)
        return sorted(found.values(), key=lambda place: (-place.value, place.columns))[:num_named]


def _distinct(ranks: NDArray[np.int16]) -> Index:
    """Columns that differ within some group, the first of equal ones."""
    varying = np.flatnonzero(ranks.any(axis=(0, 1)))
    first: dict[bytes, int] = {}
    for column in varying.tolist():
        first.setdefault(np.ascontiguousarray(ranks[:, :, column]).tobytes(), column)
    return np.array(sorted(first.values()), np.intp)


def _surprise(ranks: NDArray[np.int16]) -> Array:
    """Logarithm of the number of orders that the rows of a group can be in, ``[groups, columns]``."""
    num_actions = ranks.shape[1]
    # A row that is one of m equal ones takes log(m!) / m, so that a tie takes log(m!).
    share = np.array([0.0] + [math.lgamma(m + 1) / m for m in range(1, num_actions + 1)])
    taken = np.zeros((ranks.shape[0], ranks.shape[2]))
    for action in range(num_actions):
        equal = (ranks == ranks[:, action : action + 1]).sum(axis=1)
        taken += share[equal]
    return math.lgamma(num_actions + 1) - taken


def _by_spread(spread: NDArray[np.float32]) -> Index:
    """Groups by how far the columns of a variable lie apart ``[groups, columns]``, in middle positive ones, falling."""
    score = np.zeros(len(spread))
    for column in spread.T.astype(np.float64):
        positive = np.sort(column[(column > 0) & np.isfinite(column)])
        unit = positive[(len(positive) - 1) // 2] if len(positive) else 1.0
        score = np.maximum(score, column / unit)
    return np.argsort(-score, kind="stable")


@dataclass(frozen=True, eq=False)
class Interaction:
    """Largest dependence of a product of two signs on the action.

    Attributes:
        signs: Signs ``[groups * actions, columns]``.
        columns: What the last axis holds.
        mean: Expected sum of a pair for an action ``[columns, columns]``.
        unit: Factor from squared distances to the statistic ``[columns, columns]``, 0 but above the diagonal.
    """

    signs: Steps
    columns: Index
    mean: Array
    unit: Array

    @classmethod
    def of(cls, table: Ranks, commands: Sequence[int]) -> Interaction:
        """Products of the commands, columns of the table; equal ones once."""
        chosen = np.array(commands, np.intp)
        signs = np.sign(table.ranks[:, :, chosen]).astype(np.int16)
        chosen, signs = chosen[_distinct(signs)], signs[:, :, _distinct(signs)]
        of_group = signs.astype(np.float64)
        num_actions = signs.shape[1]
        product = np.einsum("gaj,gak->gjk", of_group, of_group) / num_actions
        square = np.einsum("gaj,gak->jk", np.square(of_group), np.square(of_group)) / num_actions
        variance = square - np.square(product).sum(axis=0)
        upper = np.triu(np.ones(variance.shape, np.bool_), 1) & (variance > 1e-9)
        scale = (num_actions - 1) / num_actions
        unit = np.divide(scale, variance, out=np.zeros_like(variance), where=upper)
        steps = signs.reshape(len(signs) * num_actions, len(chosen)).astype(np.float32)
        return cls(steps, chosen, product.sum(axis=0), unit)

    @property
    def scratch_columns(self) -> int:
        """Float64 numbers that a permutation needs for every action; permutations are taken one by one."""
        return 0

    def _values(self, rows: Index) -> Array:
        """The statistic of every pair ``[columns, columns]`` for labels ``[groups, actions]``."""
        num_groups, num_actions = rows.shape
        place = rows + num_actions * np.arange(num_groups)[:, None]
        drawn = self.signs.take(place.T, axis=0)  # [actions, groups, columns]
        sums = np.matmul(drawn.transpose(0, 2, 1), drawn).astype(np.float64)
        sums -= self.mean
        return np.asarray(np.einsum("ajk,ajk->jk", sums, sums) * self.unit)

    def __call__(self, rows: Index) -> Array:
        """``T`` of every permutation ``[permutations]``, labels ``[permutations, groups, actions]``."""
        if len(self.columns) < 2:
            return np.zeros(len(rows))
        return np.array([self._values(own).max() for own in rows])

    def places(self, rows: Index, num_named: int) -> list[Place]:
        """The largest pairs of one labelling ``[1, groups, actions]``, largest first."""
        if len(self.columns) < 2:
            return []
        values = self._values(rows[0])
        pairs = np.argwhere(self.unit > 0)
        strongest = sorted(pairs.tolist(), key=lambda pair: (-values[pair[0], pair[1]], pair))[:num_named]
        found = [(int(self.columns[one]), int(self.columns[other])) for one, other in strongest]
        sizes = [float(values[one, other]) for one, other in strongest]
        return [Place(pair, rows.shape[1], value) for pair, value in zip(found, sizes, strict=True)]
