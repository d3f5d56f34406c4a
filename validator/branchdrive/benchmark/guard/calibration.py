"""Which selection of the path is taken, from its losses on the calibration partition.

Conformal risk control on clusters: with the mean envelope loss ``E_c`` of the groups of cluster ``c``::

    lambda_hat = min {lambda : (sum_c E_c(lambda) + 1) / (C + 1) <= alpha}

The envelope rises along the path and is at most 1, so for exchangeable clusters the expected loss of a
random group of a new cluster is at most alpha.

Learn then test beside it: one group of every cluster, drawn before losses are looked at, and along the path
from nominal on a multiplier is kept as long as ``P(Bin(C, alpha) <= losses at the multiplier) <= delta``. With
independent clusters all that is kept has a rate of at most alpha, but for calibration draws of probability delta.

Source: Angelopoulos et al. 2022, arXiv 2208.02814, theorem 1; Angelopoulos et al. 2021, arXiv 2110.01052, its
fixed sequence.

What the guards promise, and what they do not: texts that a report prints verbatim where they are claimed.

The numbers are those of `calibration.ALPHA`, `calibration.DELTA` and `path.TOLERANCE_M`; with others, or where
`calibration.Calibration.refusal` says why nothing was judged, the texts do not hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.guard.path import TOLERANCE_M, envelope
from branchdrive.statistics.binomial import binomial_cdf, exact_fraction
from branchdrive.statistics.random_words import words

__all__ = [
    "ALPHA",
    "CONDITIONAL",
    "DELTA",
    "DEVELOPMENT",
    "GLOBAL_MARGIN",
    "GUARANTEE",
    "LEARN_THEN_TEST",
    "MIN_CLUSTERS",
    "MIN_GROUPS",
    "Calibration",
    "conformal",
    "guarantee",
    "learn_then_test",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ALPHA = 0.05
"""Largest rate of violations."""

DELTA = 0.1
"""Probability over calibration draws with which learn then test may fail."""

MIN_GROUPS = 88
MIN_CLUSTERS = 48
"""Fewer calibration groups or clusters are not judged: the guard stays nominal and says so."""

_STREAM = "guard/one-group-of-a-cluster"


class Calibration(NamedTuple):
    """The place on the path that is taken.

    Attributes:
        method: ``conformal`` or ``learn_then_test``.
        place: Place on the axis of multipliers; 0 is always nominal.
        num_groups: Calibration groups.
        num_clusters: Calibration clusters.
        curve: What is compared with the limit ``[multipliers]``: the bound on the risk, or the p-value.
        limit: alpha, or delta.
        refusal: Why the guard is not judged and stays nominal; `None` where it is judged.
    """

    method: str
    place: int
    num_groups: int
    num_clusters: int
    curve: Array
    limit: float
    refusal: str | None


def conformal(
    losses: Mask,
    clusters: Sequence[str],
    *,
    alpha: float = ALPHA,
    min_groups: int = MIN_GROUPS,
    min_clusters: int = MIN_CLUSTERS,
) -> Calibration:
    """Conformal risk control of the envelope on cluster means.

    Args:
        losses: Violations along the path ``[multipliers, groups]``, none at its start; see `path.violations`.
        clusters: Cluster of every group ``[groups]``.
        alpha: In ``(0, 1)``.
        min_groups: Fewer are not judged.
        min_clusters: Fewer are not judged.

    Raises:
        ValueError: Shapes do not match, the path does not start at nominal, or alpha is out of range.
    """
    _check(losses, clusters, alpha)
    worst = envelope(losses)
    place_of, sizes = np.unique(np.asarray(clusters, np.str_), return_inverse=True, return_counts=True)[1:]
    size = sizes[place_of]
    # Sums by size of cluster are integers, so that no order of groups and no rounding decides at the limit.
    totals = [(int(each), worst[:, size == each].sum(axis=1).tolist()) for each in np.unique(size)]
    bounds = [
        (sum((Fraction(counts[multiplier], each) for each, counts in totals), Fraction(1))) / (len(sizes) + 1)
        for multiplier in range(len(losses))
    ]
    kept = [multiplier for multiplier, bound in enumerate(bounds) if bound <= exact_fraction(alpha)]
    refusal = _too_few(len(clusters), len(sizes), min_groups, min_clusters)
    if refusal is None and not kept:
        refusal = f"{len(sizes)} clusters cannot bound a rate of {alpha:g}: 1 / {len(sizes) + 1} is above it"
    place = 0 if refusal else max(kept)
    curve = np.array([float(bound) for bound in bounds])
    return Calibration("conformal", place, len(clusters), len(sizes), curve, alpha, refusal)


def learn_then_test(
    losses: Mask,
    clusters: Sequence[str],
    groups: Sequence[str],
    *,
    seed: int,
    alpha: float = ALPHA,
    delta: float = DELTA,
    min_groups: int = MIN_GROUPS,
    min_clusters: int = MIN_CLUSTERS,
) -> Calibration:
    """Fixed-sequence test with exact binomial p-values on one group of every cluster.

    Nominal needs no test: it has no loss.

    Args:
        losses: As for `conformal`.
        clusters: Cluster of every group ``[groups]``.
        groups: Identifier of every group; they decide the draw together with `seed`, in whatever order they come.
        seed: In ``[0, 2^64)``.
        alpha: In ``(0, 1)``.
        delta: In ``(0, 1)``.
        min_groups: Fewer are not judged.
        min_clusters: Fewer are not judged.

    Raises:
        ValueError: As for `conformal`, or identifiers repeat.
    """
    _check(losses, clusters, alpha)
    drawn = losses[:, _one_of_each(clusters, groups, seed)]
    num_drawn = drawn.shape[1]
    counts = drawn.sum(axis=1).tolist()
    p_values = {count: binomial_cdf(count, num_drawn, alpha) for count in {0, *counts}}
    curve = np.array([p_values[count] for count in counts])
    refusal = _too_few(len(clusters), num_drawn, min_groups, min_clusters)
    if refusal is None and p_values[0] > delta:
        refusal = f"{num_drawn} clusters cannot show a rate of {alpha:g}: without a violation p is {p_values[0]:.3g}"
    failing = np.flatnonzero(curve[1:] > delta)
    place = 0 if refusal else int(failing[0]) if len(failing) else len(curve) - 1
    return Calibration("learn_then_test", place, len(clusters), num_drawn, curve, delta, refusal)


def _check(losses: Mask, clusters: Sequence[str], alpha: float) -> None:
    if losses.ndim != 2 or not len(losses) or losses.shape[1] != len(clusters):
        raise ValueError(f"losses {list(losses.shape)} do not match {len(clusters)} groups: [multipliers, groups]")
    if losses[0].any():
        raise ValueError("the path starts with a violation; it must start at nominal, which has none")
    if not 0 < alpha < 1:
        raise ValueError(f"`alpha` is {alpha!r}, not between 0 and 1")


def _too_few(num_groups: int, num_clusters: int, min_groups: int, min_clusters: int) -> str | None:
    if num_groups >= min_groups and num_clusters >= min_clusters:
        return None
    return (
        f"{num_groups} calibration groups of {num_clusters} clusters, expected at least {min_groups} groups "
        f"of {min_clusters} clusters"
    )


def _one_of_each(clusters: Sequence[str], groups: Sequence[str], seed: int) -> list[int]:
    """Places of the drawn groups: of every cluster the one with the least random word."""
    if len(groups) != len(clusters) or len(set(groups)) != len(groups):
        raise ValueError(f"{len(groups)} groups do not name each of {len(clusters)} once")
    drawn = words(seed, _STREAM, 1, len(groups))[0].tolist()
    first: dict[str, tuple[int, int]] = {}
    for word, place in zip(drawn, sorted(range(len(groups)), key=groups.__getitem__), strict=True):
        first[clusters[place]] = min(first.get(clusters[place], (word, place)), (word, place))
    return sorted(place for _, place in first.values())


GUARANTEE = (
    "Assume that the calibration route clusters and the cluster of a new group are exchangeable, and that predictor, "
    "risk scores, utility, tolerance and multiplier grid were fixed before any calibration outcome was read. Then the "
    "probability, over the calibration data and a group drawn at random from the new cluster among those in which "
    "every candidate has its separation and its utility, that the guarded selector takes an action of the fixed bank "
    "other than nominal whose recorded minimum separation is more than 0.25 m below the recorded nominal one is at "
    "most 0.05. This holds on average only: not for a given calibration set, scenario or action, and not given that "
    "the selector intervenes; given one calibration set the rate can exceed 0.05. Every profile is calibrated by "
    "itself, and a choice among profiles after their results is not covered. The guarantee says nothing about "
    "collisions, about actions outside of the bank, about closed-loop driving, about groups without a recorded "
    "separation or utility, or about another simulator or a road."
)
"""Guarantee of `calibration.conformal` with its limits."""


def guarantee(tolerance_m: float) -> str:
    """The same at another tolerance in metres."""
    return GUARANTEE.replace(f"{TOLERANCE_M:g} m", f"{tolerance_m:g} m")


CONDITIONAL = (
    "The rate given one calibration set can exceed 0.05: in simulations with 48 to 65 calibration clusters it did for "
    "19 to 28 % of the calibration sets, with a mean of 0.033 to 0.039 over all of them."
)
"""What the average of `GUARANTEE` leaves open, printed after it.

Clusters of 1 to 7 groups, normal latent risks with a correlation of 0, 0.4 and 0.8 within clusters, 30 or 100
multipliers along which the true rate of the envelope rises evenly from 0 to 0.2 or 0.5; 1,500 draws each.
"""

LEARN_THEN_TEST = (
    "Assume that the calibration route clusters are independent and distributed like the cluster of a new group, and "
    "that predictor, risk scores, utility, tolerance and multiplier grid were fixed before any calibration outcome was "
    "read. Then with probability at least 0.9 over calibration draws the rate of such selections by learn then test in "
    "new clusters is at most 0.05. The other limits are the same."
)
"""Guarantee of `calibration.learn_then_test`, printed after `GUARANTEE`."""

GLOBAL_MARGIN = (
    "The global margin is an empirical quantile of its calibration groups, with the rank the paper uses. "
    "It comes without a finite-sample guarantee; its coverage figures describe the groups they were counted on."
)
"""What the paper's guard promises."""

DEVELOPMENT = (
    "The global margin is fitted on `val`, which chose the checkpoints: its figures are a development-set diagnostic, "
    "not an independent, distribution-free or conformal guarantee, as the paper says of its own."
)
"""The paper's remark on its guard, stated where redraws of the margin are shown."""
