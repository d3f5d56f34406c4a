"""Statistics table: metrics of models with intervals, and paired comparisons with p-values.

A model has one prediction per seed. Its row is the mean of the metrics of its seeds, in the estimate as in every
resample, with their standard deviation over seeds (``n - 1``) beside it. A comparison takes the errors of each
group averaged over the seeds of a model::

    d_g = mean over seeds of left_g - mean over seeds of right_g        over the groups in which all are defined

All rows share the resamples, all comparisons the sign flips. Intervals and tests are made twice: with groups as the
units, as the paper has them, and with route clusters, by which claims are judged. The groups are put in the order of
their ids first, so the order in which they are given decides nothing.

Source: paper, "Metrics and Statistics" (which averages seeds in two ways; errors reproduce its differences).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.metric.metric import METRICS, PAIRED_METRICS, MetricValues, metric_values
from branchdrive.benchmark.prediction.metric.outcome import Outcomes, Predictions
from branchdrive.benchmark.prediction.metric.scale import Scale
from branchdrive.statistics.bca import Intervals, intervals
from branchdrive.statistics.bootstrap import NUM_RESAMPLES, Design, counted_mean, design
from branchdrive.statistics.cluster import intra_cluster_correlation
from branchdrive.statistics.rounding import slack
from branchdrive.statistics.sign_flip import CLUSTER_STREAM, NUM_FLIPS, draw_signs, sign_flip, studentised_p

__all__ = [
    "Comparison", "Contrast", "Estimate", "Interval", "Statistics", "compare", "paired_difference", "statistics",
]  # fmt: skip

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Interval(NamedTuple):
    """Ends of 95 %, as in `Intervals`; NaN where there is none. `num_undefined` resamples lacked the metric."""

    low: float
    high: float
    bca_low: float
    bca_high: float
    num_undefined: int
    cluster_low: float
    cluster_high: float
    cluster_num_undefined: int

    @classmethod
    def of(cls, ends: Intervals, k: int) -> Self:
        """The interval of metric `k`."""
        return cls(*(field[k].item() for field in ends))


class Estimate(NamedTuple):
    """One metric of one model.

    Attributes:
        model: Name of the model.
        metric: Name in `METRICS`.
        value: Mean over seeds; NaN where not defined.
        seed_sd: Standard deviation over seeds (``n - 1``); NaN with one seed.
        by_seed: Value of every seed, seeds ascending.
        interval: Of `value`.
        num_groups: Groups that contribute, the least of all seeds.
    """

    model: str
    metric: str
    value: float
    seed_sd: float
    by_seed: tuple[float, ...]
    interval: Interval
    num_groups: int


class Contrast(NamedTuple):
    """A declared comparison: `left` minus `right` in one of `PAIRED_METRICS`."""

    left: str
    right: str
    metric: str

    @property
    def name(self) -> str:
        """What families call it, such as ``M3-M1.ade_m``."""
        return f"{self.left}-{self.right}.{self.metric}"


class Comparison(NamedTuple):
    """One paired comparison.

    Attributes:
        name: Name of the contrast.
        difference: Mean over groups; NaN where no group has both sides.
        interval: Of `difference`.
        p_clusters: Two-sided sign-flip p-value with clusters as the units; 1 where no group has both sides.
        is_smallest_clusters: Whether `p_clusters` is a bound: no flip reached the difference.
        p: The same with groups as the units.
        is_smallest: Whether `p` is a bound.
        studentised_p: Studentised bootstrap p-value by groups, which assumes no symmetry.
        is_smallest_studentised: Whether `studentised_p` is a bound: no resample reached the difference.
        correlation: Intra-cluster correlation of the differences; NaN where not defined.
        num_groups: Groups that have both sides.
        num_clusters: Their clusters.
    """

    name: str
    difference: float
    interval: Interval
    p_clusters: float
    is_smallest_clusters: bool
    p: float
    is_smallest: bool
    studentised_p: float
    is_smallest_studentised: bool
    correlation: float
    num_groups: int
    num_clusters: int


class Statistics(NamedTuple):
    """All rows of a table."""

    estimates: tuple[Estimate, ...]
    comparisons: tuple[Comparison, ...]


def statistics(
    group_ids: Sequence[str],
    clusters: Sequence[str],
    outcomes: Outcomes,
    predictions: Mapping[str, Mapping[int, Predictions]],
    scale: Scale,
    *,
    contrasts: Sequence[Contrast] = (),
    seed: int,
    num_resamples: int = NUM_RESAMPLES,
    num_flips: int = NUM_FLIPS,
) -> Statistics:
    """Statistics of all models.

    Args:
        group_ids: Ids of the groups ``[N]``, the order of the first axis of outcomes and predictions.
        clusters: Name of the route cluster of every group ``[N]``.
        outcomes: What was recorded.
        predictions: By model and seed.
        scale: From the training partition.
        contrasts: Comparisons to make.
        seed: Of resamples and sign flips.
        num_resamples: Resamples of the bootstrap.
        num_flips: Sign flips.

    Raises:
        ValueError: Groups do not match or repeat, a model has no prediction, or a contrast names an unknown model or
            metric.
    """
    order = _order(group_ids, clusters, outcomes)
    owners = [(model, key) for model, by_seed in predictions.items() for key in sorted(by_seed)]
    for model, by_seed in predictions.items():
        if not by_seed:
            raise ValueError(f"model {model!r} has no prediction")
    resampling = design([clusters[i] for i in order], seed=seed, num_resamples=num_resamples)
    given = [predictions[model][key].take(order) for model, key in owners]
    found = metric_values(outcomes.take(order), given, scale, resampling) if given else None
    rows = {model: [i for i, owner in enumerate(owners) if owner[0] == model] for model in predictions}
    estimates = () if found is None else _estimates(found, rows, resampling)
    by_group = (
        {} if found is None else {model: found.by_group[of_model].mean(axis=0) for model, of_model in rows.items()}
    )
    differences = [_difference(contrast, by_group) for contrast in contrasts]
    comparisons = compare(
        [contrast.name for contrast in contrasts],
        np.stack(differences, axis=1) if differences else np.empty((len(order), 0)),
        resampling,
        seed=seed,
        num_flips=num_flips,
    )
    return Statistics(estimates, comparisons)


def compare(
    names: Sequence[str], differences: Array, resampling: Design, *, seed: int, num_flips: int = NUM_FLIPS
) -> tuple[Comparison, ...]:
    """Comparisons of paired differences ``[N, K]``, NaN where a group has none, under shared resamples and signs."""
    clusters, size = resampling.clusters, resampling.num_resamples
    signs = draw_signs(len(differences), seed=seed, num_flips=num_flips)
    cluster_signs = draw_signs(len(clusters.names), seed=seed, num_flips=num_flips, stream=CLUSTER_STREAM)
    groups, whole = sign_flip(differences, signs), sign_flip(differences, cluster_signs, clusters)
    parts = resampling.split(counted_mean(resampling, differences))
    ends = intervals(*parts, groups.num_units, whole.num_units)
    studentised = studentised_p(differences, resampling.by_group)
    correlation = intra_cluster_correlation(differences, clusters)
    return tuple(
        Comparison(
            name,
            float(groups.mean[k]),
            Interval.of(ends, k),
            float(whole.p[k]),
            bool(whole.is_smallest[k]),
            float(groups.p[k]),
            bool(groups.is_smallest[k]),
            float(studentised[k]),
            bool(studentised[k] <= 1 / (size + 1)),
            float(correlation[k]),
            int(groups.num_units[k]),
            int(whole.num_units[k]),
        )
        for k, name in enumerate(names)
    )


def paired_difference(left: Array, right: Array) -> Array:
    """``left - right``, and 0 where both tie: what seeds that choose alike leave of rounding is no effect."""
    difference = left - right
    return np.where(np.abs(difference) <= slack(np.fmax(np.abs(left), np.abs(right))), 0.0, difference)


def _order(group_ids: Sequence[str], clusters: Sequence[str], outcomes: Outcomes) -> Index:
    if len(group_ids) != outcomes.num_groups or len(set(group_ids)) < len(group_ids):
        raise ValueError(
            f"{len(group_ids)} group ids, {len(set(group_ids))} of them distinct, do not name "
            f"{outcomes.num_groups} groups"
        )
    if len(clusters) != len(group_ids):
        raise ValueError(f"{len(clusters)} clusters are not those of {len(group_ids)} groups")
    return np.array(sorted(range(len(group_ids)), key=group_ids.__getitem__), np.int64)


def _estimates(found: MetricValues, rows: Mapping[str, Sequence[int]], resampling: Design) -> tuple[Estimate, ...]:
    estimates = []
    for model, of_model in rows.items():
        by_seed = found.counted[of_model, 0]
        parts = resampling.split(found.counted[of_model].mean(axis=0))
        seed_sd = by_seed.std(axis=0, ddof=1) if len(of_model) > 1 else np.full(len(METRICS), np.nan)
        contributes = found.contributes[of_model]
        num_groups = contributes.sum(axis=1).min(axis=0)
        num_clusters = np.min([resampling.clusters.num_there(of_seed) for of_seed in contributes], axis=0)
        ends = intervals(*parts, num_groups, num_clusters)
        estimates += [
            Estimate(
                model,
                metric.name,
                float(parts[0][m]),
                float(seed_sd[m]),
                tuple(by_seed[:, m].tolist()),
                Interval.of(ends, m),
                int(num_groups[m]),
            )
            for m, metric in enumerate(METRICS)
        ]
    return tuple(estimates)


def _difference(contrast: Contrast, by_group: Mapping[str, Array]) -> Array:
    unknown = [model for model in (contrast.left, contrast.right) if model not in by_group]
    if unknown or contrast.metric not in PAIRED_METRICS:
        name, allowed = (unknown[0], sorted(by_group)) if unknown else (contrast.metric, PAIRED_METRICS)
        raise ValueError(f"contrast {contrast.name!r} names {name!r}; there are {', '.join(allowed)}")
    place = [metric.name for metric in METRICS].index(contrast.metric)
    return paired_difference(by_group[contrast.left][:, place], by_group[contrast.right][:, place])
