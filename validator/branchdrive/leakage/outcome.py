"""Outcomes that what precedes a branch gives away: variables that rank one, and categories that stand for one.

* A variable tells an outcome where it ranks a target of one action, or the least, the mean or the largest of a target
  over the actions, with ``|rho| > 0.999``, or the place of the action with the least or the largest, with 0.98; an
  outcome that a speed, or variables of motion of two other columns, rank with 0.99 follows from the motion, and is no
  secret. Counts can do no better than their ties, so 0.98 is the bound of all that they tell.
* A category is a code where groups of one category nearly always share the place of an action, though no place has more
  than two thirds of the groups. With the chance ``q`` that two groups share one, the sum of the squared shares of
  places, and ``n`` groups beside the first of each category, chance does that with ``q^n``, at most 1e-4.

Source: this project's choice; spec/13-leakage.md#structural.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.leakage.rank_correlation import centred_ranks, correlations, counts_of, places_of
from branchdrive.leakage.structural import MAX_CORRELATION, TargetLeak

__all__ = ["MAX_OUTCOME_CORRELATION", "SPEED", "num_alone", "outcome_codes", "revealed_outcomes"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_OUTCOME_CORRELATION = 0.999
"""Largest correlation of a history variable with an outcome of one action, or of all: a speed reaches 0.985."""

SPEED = "state speed_mps"
"""The column whose correlation is enough by itself for an outcome to follow from the motion."""

_KNOWN_CORRELATION, _NUM_KNOWING = 0.99, 2
"""Correlation with an outcome, and how many other columns must reach it, by which the motion itself tells it."""

_NUM_PLACES = 2
"""Outcomes that are the place of an action; they come last."""

_MIN_VALUES = 10
"""Distinct values below which a correlation says nothing."""

_MIN_RANKED = 15
"""Groups below which a variable may rank one of many outcomes by chance."""

_MIN_COMMON = 3
"""Values, each of as many groups, that a place among actions and its code need."""

_MAX_CHANCE = 1e-4
"""Chance above which categories may agree with places by themselves."""

_MAX_SHARE = 2 / 3
"""Share of groups that one place may have where categories are asked for places."""

_MAX_PURE = 0.98
"""Share of groups whose place is the commonest of their category, from which the category is a code."""


class _Outcomes(NamedTuple):
    """What the candidates of groups came to: names, values and availability ``[outcomes, groups]``, what are places."""

    names: list[str]
    values: Array
    there: Mask
    is_place: Mask


def revealed_outcomes(
    variables: Array,
    columns: Sequence[str],
    targets: Array,
    available: Mask,
    *,
    motion: tuple[Array, Sequence[str]] | None = None,
    max_correlation: float = MAX_OUTCOME_CORRELATION,
) -> list[TargetLeak]:
    """Variables that rank an outcome, each target once; none are looked for among fewer than fifteen groups.

    Args:
        variables: ``[groups, variables]``; what is not there is minus infinity.
        columns: The column that each variable is a time of ``[variables]``.
        targets: ``[groups, actions, targets]``; any value where not available.
        available: ``[groups, actions, targets]``.
        motion: Variables that outcomes may follow from, and their columns; None are those that are examined.
        max_correlation: Largest correlation with an outcome that is no place.
    """
    if len(variables) < _MIN_RANKED:
        return []
    examined = _Ranked(variables, columns)
    known = examined if motion is None else _Ranked(*motion)
    found: dict[tuple[int, int], TargetLeak] = {}
    for target in range(targets.shape[2]):
        outcomes = _rich(_outcomes(targets[..., target], available[..., target]))
        rho = examined.correlations(outcomes)
        bounds = np.where(outcomes.is_place, MAX_CORRELATION, max_correlation)
        is_ranked = np.abs(rho) > bounds[:, None]
        for row in np.flatnonzero(is_ranked.any(axis=1)).tolist():
            name, there, is_place = outcomes.names[row], outcomes.there[row], outcomes.is_place[row]
            knowing = known.knowing(_of_row(outcomes, row))
            for v in () if SPEED in knowing else np.flatnonzero(is_ranked[row]).tolist():
                is_known = len(knowing - {columns[v]}) >= _NUM_KNOWING
                if not is_known and _is_rich(examined.places[v][there], is_place):
                    how = f"a rank correlation of {rho[row, v]:.4f} with {name}"
                    found.setdefault((target, v), TargetLeak(v, target, how))
    return list(found.values())


class _Ranked:
    """Variables ``[groups, variables]``, whose ranks among equal groups are computed once.

    Attributes:
        places: Of every variable, the place of each group among the distinct values ``[variables, groups]``.
    """

    def __init__(self, variables: Array, columns: Sequence[str]) -> None:
        self._variables, self._columns = variables, columns
        self._last: tuple[bytes, Array, Array] = b"", np.zeros((0, 0)), np.zeros(0)

    @cached_property
    def places(self) -> NDArray[np.int64]:
        return places_of(self._variables)

    def correlations(self, outcomes: _Outcomes) -> Array:
        """Rank correlations ``[outcomes, variables]`` over the groups that each outcome has."""
        found = np.zeros((len(outcomes.names), self._variables.shape[1]))
        there = outcomes.there.astype(np.float64)
        ranks, spreads = centred_ranks(places_of(outcomes.values.T), there)
        ranks *= there
        rows_of: dict[bytes, list[int]] = {}
        for row, own in enumerate(outcomes.there):
            rows_of.setdefault(own.tobytes(), []).append(row)
        for key, rows in rows_of.items():
            weight = there[rows[0]]
            if self._last[0] != key:
                self._last = key, *centred_ranks(self.places, weight)
            found[rows] = correlations(*self._last[1:], ranks[rows], spreads[rows], int(weight.sum()))
        return found

    def knowing(self, outcome: _Outcomes) -> set[str]:
        """Columns with a variable from whose motion an outcome follows."""
        (rho,) = self.correlations(outcome)
        return {self._columns[v] for v in np.flatnonzero(np.abs(rho) > _KNOWN_CORRELATION).tolist()}


def outcome_codes(categories: Sequence[str], targets: Array, available: Mask) -> list[tuple[int, str]]:
    """Targets of which a category tells the place of an action, and how; each target once.

    Args:
        categories: Of every group ``[groups]``.
        targets: ``[groups, actions, targets]``; any value where not available.
        available: ``[groups, actions, targets]``.
    """
    found: dict[int, str] = {}
    names = np.asarray(categories, np.str_)
    for target in range(targets.shape[2]):
        outcomes = _outcomes(targets[..., target], available[..., target])
        for row in np.flatnonzero(outcomes.is_place).tolist():
            there = outcomes.there[row]
            if how := _agreement(names[there], outcomes.values[row, there]):
                found.setdefault(target, f"{how} {outcomes.names[row]}")
    return list(found.items())


def _agreement(names: NDArray[np.str_], places: Array) -> str:
    """How categories ``[groups]`` stand for places ``[groups]``; empty where they do not."""
    _, kind, count = np.unique(names, return_inverse=True, return_counts=True)
    is_shared = count[kind] > 1
    kind, places = kind[is_shared], places[is_shared]
    num_kinds = len(np.unique(kind))
    commonest = [Counter(places[kind == one].tolist()).most_common(1)[0][1] for one in np.unique(kind)]
    share = np.unique(places, return_counts=True)[1] / max(len(places), 1)
    chance = np.square(share).sum() ** (len(places) - num_kinds)
    if chance > _MAX_CHANCE or share.max() > _MAX_SHARE or sum(commonest) < _MAX_PURE * len(places):
        return ""
    return f"{num_kinds} values, each with one answer in {sum(commonest)} of {len(places)} groups, to"


def num_alone(categories: Sequence[str]) -> int:
    """Groups whose category ``[groups]`` no other group has."""
    return sum(count == 1 for count in Counter(categories).values())


def _outcomes(values: Array, there: Mask) -> _Outcomes:
    """Outcomes of one target ``[groups, actions]``: of every action, and of all that are available in a group."""
    num_actions = values.shape[1]
    anywhere = np.asarray(there.any(axis=1))
    count = np.maximum(there.sum(axis=1), 1)
    low, high = np.where(there, values, np.inf), np.where(there, values, -np.inf)
    of_all = {
        "the least value": low.min(axis=1),
        "the mean value": np.where(there, values, 0.0).sum(axis=1) / count,
        "the largest value": high.max(axis=1),
        "the place of the least value": low.argmin(axis=1),
        "the place of the largest value": high.argmax(axis=1),
    }
    names = [*(f"the value, at action {action}," for action in range(num_actions)), *of_all]
    return _Outcomes(
        names,
        np.stack([*values.T, *of_all.values()]),
        np.stack([*there.T, *(anywhere for _ in of_all)]),
        np.arange(len(names)) >= len(names) - _NUM_PLACES,
    )


def _of_row(outcomes: _Outcomes, row: int) -> _Outcomes:
    return _Outcomes([outcomes.names[row]], outcomes.values[[row]], outcomes.there[[row]], outcomes.is_place[[row]])


def _rich(outcomes: _Outcomes) -> _Outcomes:
    """Those with enough groups, and enough distinct values for a correlation to say something.

    Values that groups share are left out of what is no place: noise on a copy orders equal ones at random.
    """
    values = np.where(outcomes.there, outcomes.values, 0.0)
    counts, own = counts_of(places_of(values.T), outcomes.there.astype(np.float64))
    there = outcomes.there & ((own == 1) | outcomes.is_place[:, None])
    is_rich = np.where(outcomes.is_place, (counts >= _MIN_COMMON).sum(axis=1) >= _MIN_COMMON, True)
    kept = np.flatnonzero(is_rich & (there.sum(axis=1) >= _MIN_RANKED))
    return _Outcomes([outcomes.names[row] for row in kept], values[kept], there[kept], outcomes.is_place[kept])


def _is_rich(values: NDArray[np.generic], is_place: bool) -> bool:
    """Whether values are distinct enough for a correlation to say something."""
    counts = np.unique(values, return_counts=True)[1]
    if is_place:
        return bool((counts >= _MIN_COMMON).sum() >= _MIN_COMMON)
    return len(counts) >= _MIN_VALUES
