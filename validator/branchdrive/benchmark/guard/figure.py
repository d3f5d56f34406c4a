"""Figures of a guarded selection: what it violates, how often it intervenes, what it gains.

Each figure is a ratio of sums over groups, ``sum_g n_g / sum_g d_g``. With executed utility ``u``, separation ``y``::

    coverage                     groups without a violation / groups
    violation                    groups with one / groups
    violation_of_clusters        the same with equal weight for every cluster: what the guarantee is about
    violation_of_interventions   groups with one / groups with an intervention; no guarantee bounds it
    intervention                 groups in which the selection is not nominal / groups
    gain                         sum (u_selected - u_nominal) / groups
    retained_gain                sum (u_selected - u_nominal) / sum (u_unguarded - u_nominal)
    separation_difference_m      sum (y_selected - y_nominal) / groups

The first five are rates; `branchdrive.benchmark.ranking.ratio` has their intervals and those of the others.

Source: this project's choice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.guard.path import TOLERANCE_M, violations
from branchdrive.benchmark.ranking.ratio import Terms, cluster_weights

__all__ = ["RATES", "terms"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

RATES = ("coverage", "violation", "violation_of_clusters", "violation_of_interventions", "intervention")
"""Figures that are shares of groups."""


def terms(
    selection: Indices,
    unguarded: Indices,
    utilities: Array,
    separation_m: Array,
    clusters: Sequence[str],
    *,
    nominal: int,
    tolerance_m: float = TOLERANCE_M,
) -> Mapping[str, Terms]:
    """Terms of every figure, by its name.

    Args:
        selection: Chosen candidates ``[groups]``.
        unguarded: Those of the same selector without a guard ``[groups]``.
        utilities: Executed utilities ``[groups, candidates]``.
        separation_m: Executed separations ``[groups, candidates]``, metres.
        clusters: Cluster of every group ``[groups]``.
        nominal: Place of the nominal candidate.
        tolerance_m: Metres.

    Raises:
        ValueError: A separation is not finite, or the arguments are not of the same groups.
    """
    if not len(selection) == len(unguarded) == len(utilities) == len(separation_m) == len(clusters):
        raise ValueError("selection, unguarded selection, utilities, separations and clusters are of the same groups")
    rows = np.arange(len(selection))
    violated = violations(selection, separation_m, nominal=nominal, tolerance_m=tolerance_m).astype(np.float64)
    intervened = (selection != nominal).astype(np.float64)
    gain, most = (utilities[rows, chosen] - utilities[:, nominal] for chosen in (selection, unguarded))
    one, weight = np.ones(len(rows)), cluster_weights(clusters)
    return {
        "coverage": Terms(1.0 - violated, one),
        "violation": Terms(violated, one),
        "violation_of_clusters": Terms(violated * weight, weight),
        "violation_of_interventions": Terms(violated, intervened),
        "intervention": Terms(intervened, one),
        "gain": Terms(gain, one),
        "retained_gain": Terms(gain, most),
        "separation_difference_m": Terms(separation_m[rows, selection] - separation_m[:, nominal], one),
    }
