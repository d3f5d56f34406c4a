"""Figures of a guarded selection, with intervals: what it violates, how often it intervenes, what it gains.

Each figure is a ratio of sums over groups, ``sum_g n_g / sum_g d_g``. With executed utility ``u``, separation ``y``::

    coverage                     groups without a violation / groups
    violation                    groups with one / groups
    violation_of_clusters        the same with equal weight for every cluster: what the guarantee is about
    violation_of_interventions   groups with one / groups with an intervention; no guarantee bounds it
    intervention                 groups in which the selection is not nominal / groups
    gain                         sum (u_selected - u_nominal) / groups
    retained_gain                sum (u_selected - u_nominal) / sum (u_unguarded - u_nominal)
    separation_difference_m      sum (y_selected - y_nominal) / groups

An interval is the 2.5 and 97.5 % percentile (linear) over 2,000 resamples of whole clusters, multinomial, shared by
all figures. Clusters stand in the order of their names, so the order of the groups decides nothing.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.derive.guard.path import TOLERANCE_M, violations

__all__ = ["NUM_RESAMPLES", "Figure", "Terms", "figures", "terms"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

NUM_RESAMPLES = 2000

_PERCENTILES = (0.025, 0.975)


class Terms(NamedTuple):
    """Numerators and denominators of a figure by group, each ``[groups]``."""

    numerator: Array
    denominator: Array


class Figure(NamedTuple):
    """One figure.

    Attributes:
        value: The ratio; `None` where its denominator is not positive.
        low: Lower end of the interval; `None` where there is no value.
        high: Upper end of the interval.
        num_undefined: Resamples whose denominator is not positive; they are left out of the interval.
    """

    value: float | None
    low: float | None
    high: float | None
    num_undefined: int


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
    place_of, sizes = np.unique(np.asarray(clusters, np.str_), return_inverse=True, return_counts=True)[1:]
    one, weight = np.ones(len(rows)), 1.0 / sizes[place_of]
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


def figures(found: Mapping[str, Terms], clusters: Sequence[str], *, seed: int) -> Mapping[str, Figure]:
    """Values and intervals of `terms`, by their names.

    Args:
        found: Terms of the same groups.
        clusters: Cluster of every group ``[groups]``.
        seed: Part of the generator's key, in ``[0, 2^64)``.

    Raises:
        ValueError: There is no group, or the seed does not fit the key.
    """
    if not len(clusters) or not 0 <= seed < 1 << 64:
        raise ValueError(f"figures need groups and a seed in [0, 2^64), found {len(clusters)} groups and seed {seed}")
    names, place_of = np.unique(np.asarray(clusters, np.str_), return_inverse=True)
    stream = int.from_bytes(hashlib.sha256(b"guard/figures").digest()[:8], "little")
    generator = np.random.Generator(np.random.Philox(key=np.array([seed, stream], np.uint64)))
    draws = generator.multinomial(len(names), np.full(len(names), 1.0 / len(names)), size=NUM_RESAMPLES)
    return {name: _figure(each, place_of, draws) for name, each in found.items()}


def _figure(found: Terms, place_of: Indices, draws: NDArray[np.int64]) -> Figure:
    top, bottom = (np.bincount(place_of, part, draws.shape[1]) for part in found)
    if not bottom.sum() > 0:
        return Figure(None, None, None, len(draws))
    tops, bottoms = draws @ top, draws @ bottom
    defined = bottoms > 0
    low, high = np.quantile(tops[defined] / bottoms[defined], _PERCENTILES).tolist()
    return Figure(float(top.sum() / bottom.sum()), low, high, int((~defined).sum()))
