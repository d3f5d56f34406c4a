"""Codes of the best action: readings of what precedes a branch whose cells have one answer each.

Units are groups of different route clusters, and the answer of a unit is its one best action. A reading is a code
where more than half of the units share their cell with another, nine in ten of these have the commonest answer of
their cell, and chance would not do that to any of all readings. For chance, answers are exchangeable over units. With
``n`` units, ``n_a`` of answer ``a`` and ``f_a = n_a / n``, cells of ``s_c`` units, of which ``N`` share theirs, ``e``
of them with another answer than the commonest, and ``M = n! / prod n_a! prod f_a^n_a``, it is at most::

    p = C(N, e) (sum_a f_a^2)^-e prod_c (sum_a f_a^s_c) / M

Were answers drawn by the shares ``f``, cells of ``s`` units would be of one answer with ``sum f^s``; leaving out one
unit raises that by at most ``1 / sum f^2``, there are ``C(N, e)`` ways to leave ``e`` out, and drawn answers have the
counts ``n_a`` with the probability ``M``, so that conditioning on them divides by no less.

Of an order of units, ``r`` neighbours have different answers. There are at most ``sum_{i <= r} C(n - 1, i) K (K -
1)^i`` such sequences of ``K`` answers, each of ``prod n_a! / n!``.

Source: this project's choice; spec/13-leakage.md#codes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.leakage.cells import Readings
from branchdrive.leakage.structural import ALPHA
from branchdrive.statistics.holm import holm

__all__ = ["Answers", "Code", "Order", "TooFewError", "best_answers", "codes"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_MIN_COMMON = 3
"""Answers, each of as many units, below which a flag of the scene may have them for a reason; rarer ones are one."""

_MAX_SHARE = 2 / 3
"""Share of units that one answer may have."""

_MIN_SHARED = 0.5
"""Share of units above which a code is one of the dataset, and no coincidence of a few."""

_MIN_PURE = 0.9
"""Share of units with the commonest answer of their cell, from which a reading is a code."""

_TIE = 1e-9
"""Values that differ by no more have no one that is the best."""

_COUNTS_AT_ONCE = 1 << 21
_FEW_CELLS = 16


class Answers(NamedTuple):
    """The best actions by one measure.

    Attributes:
        name: What is asked.
        units: The groups that have an answer, one of each route cluster ``[units]``.
        answer: Number of the answer of each, from 0, all rare ones being one ``[units]``.
        is_rich: Whether answers are many enough, and none nearly the only one.
    """

    name: str
    units: Index
    answer: Index
    is_rich: bool

    @classmethod
    def of(cls, name: str, units: Index, action: Index) -> Answers:
        """Answers of units that each have one best action ``[units]``."""
        _, place, count = np.unique(action, return_inverse=True, return_counts=True)
        is_common = count >= _MIN_COMMON
        is_rich = is_common.sum() >= _MIN_COMMON and count.max() <= _MAX_SHARE * len(units)
        answer = np.unique(np.where(is_common, np.arange(len(count)), -1)[place], return_inverse=True)[1]
        return cls(name, units, np.asarray(answer, np.int64), bool(is_rich))

    @property
    def counts(self) -> Index:
        """Units of every answer ``[answers]``."""
        return np.bincount(self.answer)


class Order(NamedTuple):
    """An order of all groups, by what may mean nothing ``[groups]``."""

    way: str
    order: Index


class TooFewError(Exception):
    """Groups are too few for any code to be told from chance."""


class Code(NamedTuple):
    """A reading that is a code: the place of its column, and how it tells which answers."""

    column: int
    how: str


class _Judged(NamedTuple):
    """Readings of a column beside answers: units that share their cell and that agree there, cells, log of chance.

    The chance of what is no code for too many units of another answer is 1.
    """

    shared: Index
    agreeing: Index
    num_cells: Index
    log_p: Array


def best_answers(name: str, values: Array, clusters: Sequence[object]) -> Answers:
    """The best action of one group of every route cluster, the first that has a single one.

    Args:
        name: What is asked.
        values: How good every action is ``[groups, actions]``, NaN where that is not known.
        clusters: Route cluster of every group ``[groups]``.
    """
    there = np.where(np.isnan(values), -np.inf, values)
    best = there.max(axis=1, initial=-np.inf, keepdims=True)
    is_single = np.isfinite(best[:, 0]) & (np.count_nonzero(there >= best - _TIE, axis=1) == 1)
    of_cluster: dict[object, int] = {}
    for group in np.flatnonzero(is_single).tolist():
        of_cluster.setdefault(clusters[group], group)
    units = np.array(sorted(of_cluster.values()), np.int64)
    return Answers.of(name, units, there[units].argmax(axis=1) if len(units) else units)


def codes(columns: Iterable[tuple[Readings, Order | None]], asked: Sequence[Answers]) -> list[Code]:
    """The readings that are codes, of every column the least probable one.

    Args:
        columns: Readings of every column, and an order that it gives.
        asked: Answers that may be told.

    Raises:
        TooFewError: Not even a reading with one cell for each answer could be told from chance.
    """
    rich = [answers for answers in asked if answers.is_rich]
    least = min((_least_chance(answers) for answers in rich), default=1.0)
    candidates: list[tuple[int, int, str]] = []
    chances: list[float] = []
    for column, (readings, order) in enumerate(columns if least <= ALPHA else ()):
        for answers in rich:
            cells = readings.cells[:, answers.units]
            tests = np.flatnonzero(_num_shared(cells) > _MIN_SHARED * len(answers.units))
            judged = _judged(cells[tests], answers)
            is_pure = judged.agreeing >= _MIN_PURE * judged.shared
            for test in np.flatnonzero(is_pure).tolist():
                how = (
                    f"{readings.ways[tests[test]]}: {judged.num_cells[test]} cells, each with one answer, in "
                    f"{judged.agreeing[test]} of {judged.shared[test]} groups, to {answers.name}"
                )
                candidates.append((len(chances) + test, column, how))
            chances += np.exp(judged.log_p).tolist()
            if order is not None:
                num_changes = _num_changes(order, answers)
                if num_changes + 1 - len(answers.counts) <= (1 - _MIN_PURE) * len(answers.units):
                    how = f"{order.way}: {len(answers.units)} groups in {num_changes + 1} runs of {answers.name}"
                    candidates.append((len(chances), column, how))
                chances.append(_chance_of_order(num_changes, answers))
    if least * max(1, len(chances)) > ALPHA:
        most = max((len(answers.units) for answers in asked), default=0)
        raise TooFewError(f"a code of the best action could not be told from chance in {most} route clusters")
    adjusted = holm(chances)
    found: dict[int, tuple[float, str]] = {}
    for test, column, how in candidates:
        if adjusted[test] <= ALPHA and (column not in found or chances[test] < found[column][0]):
            found[column] = (chances[test], how)
    return [Code(column, how) for column, (_, how) in sorted(found.items())]


def _least_chance(answers: Answers) -> float:
    """Chance of a reading with one cell for each answer."""
    return math.exp(_judged(answers.answer[None], answers).log_p[0])


def _num_shared(cells: Index) -> Index:
    """Units that share their cell ``[readings]`` of units ``[readings, units]``."""
    num_cells = int(cells.max(initial=0)) + 1
    at = cells * len(cells) + np.arange(len(cells))[:, None]
    size = np.bincount(at.ravel(), minlength=len(cells) * num_cells).reshape(num_cells, len(cells))
    return np.asarray(cells.shape[1] - (size == 1).sum(axis=0), np.int64)


def _judged(cells: Index, answers: Answers) -> _Judged:
    """Readings of the units ``[readings, units]`` beside their answers, those of few cells first and then back."""
    widths = cells.max(axis=1, initial=0) + 1
    order = np.argsort(widths, kind="stable")
    parts, start = [_judged_at_once(cells[:0], answers)], 0
    while start < len(order):
        width = int(widths[order[start]])
        stop = int(np.searchsorted(widths[order], max(2 * width, _FEW_CELLS), side="right"))
        at_once = max(1, _COUNTS_AT_ONCE // (int(widths[order[stop - 1]]) * len(answers.counts)))
        stop = min(stop, start + at_once)
        parts.append(_judged_at_once(cells[order[start:stop]], answers))
        start = stop
    back = np.argsort(order, kind="stable")
    return _Judged(*(np.concatenate(values)[back] for values in zip(*parts, strict=True)))


def _judged_at_once(cells: Index, answers: Answers) -> _Judged:
    num_units, counts, num_readings = len(answers.units), answers.counts, len(cells)
    num_cells, num_answers = int(cells.max(initial=0)) + 1, len(counts)
    # Readings are the last axis: the others are short, and sums over them are of whole rows.
    at = (answers.answer * num_cells + cells) * num_readings + np.arange(num_readings)[:, None]
    found = np.bincount(at.ravel(), minlength=num_answers * num_cells * num_readings)
    found = found.reshape(num_answers, num_cells, num_readings)
    size = found.sum(axis=0)
    is_shared = size > 1
    shared = np.where(is_shared, size, 0).sum(axis=0)
    agreeing = np.where(is_shared, found.max(axis=0), 0).sum(axis=0)
    log_p = np.zeros(num_readings)
    pure = np.flatnonzero(agreeing >= _MIN_PURE * shared)
    if len(pure):
        log_of_one = _log_of_one_answer(counts / num_units, int(size.max(initial=2)))
        log_factorial = _log_factorials(num_units)
        other = shared - agreeing
        log_ways = (log_factorial[shared] - log_factorial[other] - log_factorial[agreeing])[pure]
        log_all = log_ways - other[pure] * log_of_one[2] + log_of_one[size[:, pure]].sum(axis=0)
        log_p[pure] = np.minimum(log_all - _log_of_counts(counts), 0.0)
    return _Judged(shared, agreeing, is_shared.sum(axis=0), log_p)


def _log_of_one_answer(shares: Array, most: int) -> Array:
    """Logarithm of the chance that cells of 0 .. `most` units, two at least, have one answer each."""
    sums = np.power(shares, np.arange(most + 1)[:, None]).sum(axis=1)
    sums[:2] = 1.0
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(sums))


def _log_factorials(most: int) -> Array:
    return np.array([math.lgamma(number + 1) for number in range(most + 1)])


def _log_of_counts(counts: Index) -> float:
    """Logarithm of the chance that drawn answers have the counts that their shares give."""
    total = int(counts.sum())
    each = (count * math.log(count / total) - math.lgamma(count + 1) for count in counts.tolist())
    return math.lgamma(total + 1) + math.fsum(each)


def _num_changes(order: Order, answers: Answers) -> int:
    """Neighbours in an order of the groups that have different answers."""
    of_group = np.full(len(order.order), -1)
    of_group[answers.units] = answers.answer
    ordered = of_group[order.order]
    ordered = ordered[ordered >= 0]
    return int(np.count_nonzero(ordered[1:] != ordered[:-1]))


def _chance_of_order(num_changes: int, answers: Answers) -> float:
    """Chance of no more changes between neighbours."""
    num_units, counts = len(answers.units), answers.counts
    log_factorial, changes = _log_factorials(num_units), np.arange(num_changes + 1)
    log_sequences = log_factorial[num_units - 1] - log_factorial[changes] - log_factorial[num_units - 1 - changes]
    log_sequences += math.log(len(counts)) + changes * math.log(max(1, len(counts) - 1))
    log_each = log_factorial[counts].sum() - log_factorial[num_units]
    return min(1.0, math.fsum(np.exp(np.minimum(log_sequences + log_each, 0.0)).tolist()))
