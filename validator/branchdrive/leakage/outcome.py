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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.leakage.rank_correlation import centred_ranks, places_of, spearman
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


class _Outcome(NamedTuple):
    """Something that the candidates of a group came to: its name, values and availability ``[groups]``."""

    name: str
    values: Array
    there: Mask
    is_place: bool


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
        for outcome in _outcomes(targets[..., target], available[..., target]):
            there = outcome.there if outcome.is_place else _single(outcome.values, outcome.there)
            if there.sum() < _MIN_RANKED or not _is_rich(outcome.values[there], outcome.is_place):
                continue
            rho = examined.correlation(outcome.values, there)
            known_rho = rho if known is examined else known.correlation(outcome.values, there)
            knowing = known.columns_of(np.abs(known_rho) > _KNOWN_CORRELATION)
            bound = MAX_CORRELATION if outcome.is_place else max_correlation
            for v in () if SPEED in knowing else np.flatnonzero(np.abs(rho) > bound).tolist():
                is_known = len(knowing - {columns[v]}) >= _NUM_KNOWING
                if not is_known and _is_rich(examined.places[v][there], outcome.is_place):
                    how = f"a rank correlation of {rho[v]:.4f} with {outcome.name}"
                    found.setdefault((target, v), TargetLeak(v, target, how))
    return list(found.values())


class _Ranked:
    """Variables ``[groups, variables]``, whose ranks among equal groups are computed once.

    Attributes:
        places: Of every variable, the place of each group among the distinct values ``[variables, groups]``.
    """

    def __init__(self, variables: Array, columns: Sequence[str]) -> None:
        self.places = places_of(variables)
        self._columns = columns
        self._there: bytes = b""
        self._ranks: tuple[Array, Array] = (np.zeros((0, 0)), np.zeros(0))

    def correlation(self, values: Array, there: Mask) -> Array:
        """Rank correlation with the values ``[groups]`` of the groups that are `there`, ``[variables]``."""
        if self._there != there.tobytes():
            self._there, self._ranks = there.tobytes(), centred_ranks(self.places, there.astype(np.float64))
        return spearman(*self._ranks, np.where(there, values, 0.0)[:, None], there[:, None])

    def columns_of(self, marked: Mask) -> set[str]:
        """Columns with a variable that is marked ``[variables]``."""
        return {self._columns[v] for v in np.flatnonzero(marked).tolist()}


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
        for outcome in _outcomes(targets[..., target], available[..., target]):
            if outcome.is_place and (how := _agreement(names[outcome.there], outcome.values[outcome.there])):
                found.setdefault(target, f"{how} {outcome.name}")
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


def _outcomes(values: Array, there: Mask) -> list[_Outcome]:
    """Outcomes of one target ``[groups, actions]``: of every action, and of all that are available in a group."""
    found = [
        _Outcome(f"the value, at action {action},", values[:, action], there[:, action], False)
        for action in range(values.shape[1])
    ]
    anywhere: Mask = np.asarray(there.any(axis=1))
    count = np.maximum(there.sum(axis=1), 1)
    low, high = np.where(there, values, np.inf), np.where(there, values, -np.inf)
    of_all = {
        "the least value": low.min(axis=1),
        "the mean value": np.where(there, values, 0.0).sum(axis=1) / count,
        "the largest value": high.max(axis=1),
    }
    found += [_Outcome(name, y, anywhere, False) for name, y in of_all.items()]
    places = {"the place of the least value": low.argmin(axis=1), "the place of the largest value": high.argmax(axis=1)}
    for name, y in places.items():
        found.append(_Outcome(name, y.astype(np.float64), anywhere, True))
    return found


def _single(values: Array, there: Mask) -> Mask:
    """Groups whose value no other group has: noise on a copy orders equal ones at random."""
    own = np.flatnonzero(there)
    _, place, count = np.unique(values[own], return_inverse=True, return_counts=True)
    single = np.zeros(len(values), np.bool_)
    single[own[count[place] == 1]] = True
    return single


def _is_rich(values: NDArray[np.generic], is_place: bool) -> bool:
    """Whether values are distinct enough for a correlation to say something."""
    counts = np.unique(values, return_counts=True)[1]
    if is_place:
        return bool((counts >= _MIN_COMMON).sum() >= _MIN_COMMON)
    return len(counts) >= _MIN_VALUES
