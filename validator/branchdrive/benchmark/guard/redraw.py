"""What guards do over further divisions of the same clusters into those that calibrate and others.

The clusters of two partitions, ``C`` of them in the calibrating one, are one pool of ``K``. A redraw is a uniform
permutation of the pool: a guard is calibrated on its first ``C`` clusters, and judged on the others::

    rate_r          mean over the other clusters of the share of their groups with a violation
    mean            mean_r rate_r                            beside the rate that is promised
    retained gain   sum_r gain_r / sum_r gain of the unguarded choice, over groups of the other clusters

Where the two partitions are a uniform division of one pool, a redraw is as likely as the draw that was made, and the
promise of the conformal choice is about the mean of the rate over all of them. Least numbers of groups and clusters
are those of the draw that was made. Bounds are compared with a slack of 1e-9.

Percentiles of 2.5 and 97.5 % (linear) over redraws say how much one draw may differ, not how well another pool is
known; the error of the mean is that of counting so many redraws alone. Nothing may be chosen by these figures.

Source: this project's choice; the check of Angelopoulos and Bates 2021, arXiv 2107.07511, section 4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.guard.data import CompleteGroups, Setting
from branchdrive.benchmark.guard.path import (
    COVERAGE,
    GlobalMargin,
    envelope,
    margin_selection,
    violations,
    worst_overprediction,
)
from branchdrive.benchmark.ranking.measure import choose
from branchdrive.driving.utility import RANGE, TIE
from branchdrive.statistics.binomial import binomial_cdf, exact_fraction
from branchdrive.statistics.random_words import orders, words

__all__ = [
    "Executed",
    "Pool",
    "Redraws",
    "conformal_places",
    "judged",
    "learn_then_test_places",
    "margin_places",
    "pool_of",
    "redrawn_margin",
    "redrawn_path",
]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
Groups = tuple[tuple[str, str], ...]

_PERCENTILES = (0.025, 0.975)
_CLUSTERS, _GROUPS = "guard/redraws", "guard/redraws/groups"


class Pool(NamedTuple):
    """Clusters of two partitions, and which of them calibrate in every redraw.

    Attributes:
        place_of: Cluster of every group ``[groups]``, of each partition in the order of their names.
        drawn: Whether a cluster calibrates ``[redraws, clusters]``.
        single: Whether a group is the one of a calibrating cluster that learn then test takes ``[redraws, groups]``.
    """

    place_of: Indices
    drawn: Mask
    single: Mask


class Executed(NamedTuple):
    """What redraws are judged by.

    Attributes:
        utilities: Executed utilities ``[groups, candidates]``.
        separation_m: Executed separations ``[groups, candidates]``, metres.
        nominal: Place of the nominal candidate.
        tolerance_m: Of a violation, metres.
        alpha: The rate that `Redraws.share_above` counts from.
    """

    utilities: Array
    separation_m: Array
    nominal: int
    tolerance_m: float
    alpha: float


class Redraws(NamedTuple):
    """A guard over redraws.

    Attributes:
        num_clusters: Clusters that calibrate.
        num_others: Clusters that it is judged on.
        mean: Mean rate of violations, clusters with equal weight.
        error: Standard error of the mean from the number of redraws alone.
        low: Percentile of 2.5 % of the rates.
        high: Percentile of 97.5 %.
        share_above: Share of the redraws with a rate above the limit.
        num_nominal: Redraws in which the guard takes nominal everywhere.
        retained_gain: Ratio of the sums over all redraws; `None` where the unguarded gain is not above `RANGE`
            for each group.
        retained_low: Percentile of 2.5 % of the ratios of single redraws, those that are defined.
        retained_high: Percentile of 97.5 %.
        num_undefined: Redraws without a ratio.
    """

    num_clusters: int
    num_others: int
    mean: float
    error: float
    low: float
    high: float
    share_above: float
    num_nominal: int
    retained_gain: float | None
    retained_low: float | None
    retained_high: float | None
    num_undefined: int


def redrawn_margin(val: CompleteGroups, tested: CompleteGroups, setting: Setting, num_redraws: int) -> Redraws:
    """The global margin over redraws of validation and test clusters."""
    nominal, limits = setting.nominal, setting.limits
    pool = pool_of(val.members, tested.members, seed=setting.seed, num_redraws=num_redraws)
    predicted_m, utilities = (
        np.concatenate([getattr(part, name) for part in (val, tested)])
        for name in ("predicted_m", "predicted_utilities")
    )
    executed = _executed(val, tested, setting)
    worst = worst_overprediction(predicted_m, executed.separation_m, nominal=nominal)
    margins, places = margin_places(worst, pool, coverage=limits.coverage)
    selections = np.stack(
        [
            margin_selection(predicted_m, utilities, GlobalMargin(margin_m, 0, 0), nominal=nominal)
            for margin_m in margins.tolist()
        ]
    )
    return judged(selections, choose(utilities), executed, pool, places)


def redrawn_path(
    cal: CompleteGroups,
    tested: CompleteGroups,
    selections: Indices,
    is_judged: Mapping[str, bool],
    setting: Setting,
    num_redraws: int,
) -> dict[str, Redraws | None]:
    """The selection path over redraws of calibration and test clusters; `None` where it was not judged."""
    if not any(is_judged.values()):
        return dict.fromkeys(is_judged)
    pool = pool_of(cal.members, tested.members, seed=setting.seed, num_redraws=num_redraws)
    executed = _executed(cal, tested, setting)
    limits = setting.limits
    losses = violations(selections, executed.separation_m, nominal=setting.nominal, tolerance_m=limits.tolerance_m)
    places = {
        "conformal": conformal_places(losses, pool, alpha=limits.alpha),
        "learn_then_test": learn_then_test_places(losses, pool, alpha=limits.alpha, delta=limits.delta),
    }
    return {
        name: judged(selections, selections[-1], executed, pool, places[name]) if holds else None
        for name, holds in is_judged.items()
    }


def _executed(one: CompleteGroups, other: CompleteGroups, setting: Setting) -> Executed:
    """What the groups of two partitions are judged by."""
    utilities, separation_m = (
        np.concatenate([getattr(part, name) for part in (one, other)]) for name in ("utilities", "separation_m")
    )
    return Executed(utilities, separation_m, setting.nominal, setting.limits.tolerance_m, setting.limits.alpha)


@lru_cache(maxsize=4)
def pool_of(calibrating: Groups, others: Groups, *, seed: int, num_redraws: int) -> Pool:
    """The pool of two partitions, groups and clusters of the calibrating one first.

    Args:
        calibrating: Identifier and cluster of every group of the one, at least one.
        others: The same of the other, at least one; no group and no cluster is in both.
        seed: In ``[0, 2^64)``.
        num_redraws: At least 1.

    Raises:
        ValueError: The seed does not fit.
    """
    place_of, other_of = (
        np.unique(np.array([cluster for _, cluster in part], np.str_), return_inverse=True)[1]
        for part in (calibrating, others)
    )
    num_drawn = int(place_of.max()) + 1
    place_of = np.concatenate([place_of, other_of + num_drawn])
    order = orders(words(seed, _CLUSTERS, num_redraws, int(place_of.max()) + 1))
    drawn = np.zeros(order.shape, np.bool_)
    np.put_along_axis(drawn, order[:, :num_drawn], values=True, axis=1)
    return Pool(place_of, drawn, _single([*calibrating, *others], place_of, drawn, seed))


def _single(groups: Sequence[tuple[str, str]], place_of: Indices, drawn: Mask, seed: int) -> Mask:
    """Of every calibrating cluster the group with the least word, a word for each group in the order of identifiers."""
    rank = np.argsort(np.argsort(np.array([group for group, _ in groups], np.str_), kind="stable"))
    word = words(seed, _GROUPS, len(drawn), len(groups))[:, rank]
    order = np.argsort(place_of, kind="stable")
    least = np.minimum.reduceat(word[:, order], np.flatnonzero(np.diff(place_of[order], prepend=-1)), axis=1)
    return np.asarray((word == least[:, place_of]) & drawn[:, place_of])


def conformal_places(losses: Mask, pool: Pool, *, alpha: float) -> Indices:
    """Place on the path of the conformal choice in every redraw ``[redraws]``; see `calibration.conformal`.

    Args:
        losses: Violations along the path ``[multipliers, groups]``, none at its start.
        pool: Of the same groups.
        alpha: In ``(0, 1)``.
    """
    means = _by_cluster(envelope(losses), pool) / np.bincount(pool.place_of)
    drawn = pool.drawn.astype(np.float64)
    bounds = (means @ drawn.T + 1) / (drawn.sum(axis=1) + 1)
    return _last(bounds <= alpha + TIE)


def learn_then_test_places(losses: Mask, pool: Pool, *, alpha: float, delta: float) -> Indices:
    """Place on the path of learn then test in every redraw ``[redraws]``; see `calibration.learn_then_test`.

    Args:
        losses: As above.
        pool: Of the same groups.
        alpha: In ``(0, 1)``.
        delta: In ``(0, 1)``.
    """
    num_drawn = int(pool.drawn[0].sum())
    counts = np.rint(losses.astype(np.float64) @ pool.single.T.astype(np.float64))
    most = -1
    while most < num_drawn and binomial_cdf(most + 1, num_drawn, alpha) <= delta:
        most += 1
    return _last(np.logical_and.accumulate(counts <= most, axis=0))


def margin_places(worst_m: Array, pool: Pool, *, coverage: float = COVERAGE) -> tuple[Array, Indices]:
    """Margins that redraws fit, ascending ``[margins]``, and which of them each fits ``[redraws]``.

    Args:
        worst_m: Largest overprediction of every group ``[groups]``, metres; see `path.fit_margin`.
        pool: Of the same groups.
        coverage: Share of the calibrating groups that a margin covers.
    """
    order = np.argsort(worst_m, kind="stable")
    counts = pool.drawn[:, pool.place_of[order]].cumsum(axis=1)
    share = exact_fraction(coverage)
    ranks = -(-counts[:, -1] * share.numerator // share.denominator)
    fitted = worst_m[order][(counts >= ranks[:, None]).argmax(axis=1)]
    margins, places = np.unique(fitted, return_inverse=True)
    return margins, places


def judged(selections: Indices, unguarded: Indices, executed: Executed, pool: Pool, places: Indices) -> Redraws:
    """What the choices of every redraw do on the clusters that did not calibrate.

    Args:
        selections: Chosen candidates ``[choices, groups]``.
        unguarded: Those of the same selector without a guard ``[groups]``.
        executed: Outcomes of the same groups.
        pool: Of the same groups.
        places: The choice of every redraw ``[redraws]``.
    """
    nominal, rows = executed.nominal, np.arange(len(unguarded))
    losses = violations(selections, executed.separation_m, nominal=nominal, tolerance_m=executed.tolerance_m)
    gains, most = (
        executed.utilities[rows, chosen] - executed.utilities[:, nominal] for chosen in (selections, unguarded[None])
    )
    sizes = np.bincount(pool.place_of).astype(np.float64)
    others = (~pool.drawn).astype(np.float64)
    num_others = int(others[0].sum())
    rates = (others * (_by_cluster(losses, pool) / sizes)[places]).sum(axis=1) / num_others
    top = (others * _by_cluster(gains, pool)[places]).sum(axis=1)
    bottom, num_groups = others @ _by_cluster(most, pool)[0], others @ sizes
    defined = bottom > RANGE * num_groups
    ratios = top[defined] / bottom[defined]
    low, high = np.quantile(rates, _PERCENTILES).tolist()
    retained_low, retained_high = np.quantile(ratios, _PERCENTILES).tolist() if len(ratios) else (None, None)
    is_defined = float(bottom.sum()) > RANGE * float(num_groups.sum())
    return Redraws(
        num_clusters=int(pool.drawn[0].sum()),
        num_others=num_others,
        mean=float(rates.mean()),
        error=float(rates.std() / np.sqrt(len(rates))),
        low=low,
        high=high,
        share_above=float((rates > executed.alpha + TIE).mean()),
        num_nominal=int((selections == nominal).all(axis=1)[places].sum()),
        retained_gain=float(top.sum() / bottom.sum()) if is_defined else None,
        retained_low=retained_low,
        retained_high=retained_high,
        num_undefined=int((~defined).sum()),
    )


def _by_cluster(values: NDArray[np.generic], pool: Pool) -> Array:
    """Sums of values ``[choices, groups]`` over the groups of every cluster ``[choices, clusters]``."""
    order = np.argsort(pool.place_of, kind="stable")
    starts = np.flatnonzero(np.diff(pool.place_of[order], prepend=-1))
    return np.asarray(np.add.reduceat(values[:, order].astype(np.float64), starts, axis=1))


def _last(kept: Mask) -> Indices:
    """The last kept place of every column of ``[multipliers, redraws]``; 0 where none is."""
    return np.where(kept.any(axis=0), len(kept) - 1 - kept[::-1].argmax(axis=0), 0)
