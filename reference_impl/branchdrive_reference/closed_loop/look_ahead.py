"""Regret by look-ahead: what the best candidate would have been worth at each decision, in the state of the drive then.

At a decision all candidates are driven ahead from the same state, by passages of their own from tick 0. With executed
utilities ``u_a`` of their windows and the choice ``c``::

    regret = (max u_a - u_c) / (max u_a - min u_a), and 0 where these have no range

A decision is ranked where every candidate has a utility; one whose window the drive's end cuts off has none. Later
decisions of a drive are weighed alike, and intervals resample route clusters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.ranking.measure import by_score, measures
from branchdrive.benchmark.ranking.ratio import Terms, figures
from branchdrive.driving.target import Targets
from branchdrive.driving.utility import utility
from branchdrive_reference.closed_loop.arm import Arm
from branchdrive_reference.closed_loop.selector import Training

__all__ = ["decision_regrets", "executed_utilities", "look_ahead_results"]

Array = NDArray[np.float64]
Document = Mapping[str, Any]


def executed_utilities(banks: Sequence[Sequence[Sequence[float | None]]], training: Training) -> Array:
    """Utilities of candidates ``[n, A]``, NaN without one, of banks of executed targets as JSON data."""
    values = np.array(
        [[[np.nan if value is None else value for value in row] for row in bank] for bank in banks], np.float64
    )
    return utility(Targets(values, np.isfinite(values)), training.scale, training.profile)


def decision_regrets(group: Document, place: int, arm: Arm, training: Training) -> Array:
    """Regret at each decision of an arm's drive in a group ``[decisions]``, NaN where it is not ranked.

    Args:
        group: File of the group, with the banks of all states.
        place: Place of the arm.
        arm: The arm.
        training: What utility is weighed by.
    """
    choices = group["drives"][place]["choices"]
    schedule = arm.schedule
    key = (schedule.every_ticks, schedule.num_decisions, arm.condition.replay)
    banks = {
        tuple(one["choices"]): one["bank"]
        for one in group["banks"]
        if (one["every_ticks"], one["num_decisions"], one["replay_noise"]) == key
    }
    utilities = executed_utilities([banks[tuple(choices[:i])] for i in range(len(choices))], training)
    found, ranked = np.full(len(choices), np.nan), np.isfinite(utilities).all(axis=1)
    if ranked.any():
        chosen = np.array([training.bank.keys.index(key) for key in choices])[ranked]
        shares = by_score(np.eye(len(training.bank.keys))[chosen])
        found[ranked] = measures(shares, utilities[ranked], nominal=training.bank.nominal_index).regret
    return found


def look_ahead_results(
    driven: Sequence[Document],
    names: Sequence[str],
    arms: Sequence[Arm],
    training: Training,
    statistics: Mapping[str, int],
) -> list[dict[str, Any]]:
    """Regret of each arm at its first decision, at later ones, and at every one by its number, as JSON data.

    Args:
        driven: Files of groups that were driven, all with banks of all states.
        names: Route cluster of each.
        arms: What was driven.
        training: What utility is weighed by.
        statistics: Seed and resamples.
    """
    terms: dict[str, Terms] = {}
    for i, arm in enumerate(arms):
        table = np.full((len(driven), arm.schedule.num_decisions), np.nan)
        for row, group in zip(table, driven, strict=True):
            regrets = decision_regrets(group, i, arm, training)
            row[: len(regrets)] = regrets
        known, values = np.isfinite(table).astype(np.float64), np.nan_to_num(table)
        parts = {"first": slice(0, 1), "later": slice(1, None)}
        parts |= {str(number): slice(number, number + 1) for number in range(table.shape[1])}
        for name, part in parts.items():
            terms[f"{i} {name}"] = Terms(values[:, part].sum(axis=1), known[:, part].sum(axis=1))
    found = figures(terms, names, seed=statistics["seed"], num_resamples=statistics["resamples"], rates=[])

    def summary(name: str) -> dict[str, Any]:
        figure, num_ranked = found[name], int(terms[name].denominator.sum())
        return {"value": figure.value, "low": figure.low, "high": figure.high, "num_ranked": num_ranked}

    return [
        {
            "first": summary(f"{i} first"),
            "later": summary(f"{i} later"),
            "by_decision": [summary(f"{i} {number}") for number in range(arm.schedule.num_decisions)],
        }
        for i, arm in enumerate(arms)
    ]
