"""Statistics table: metrics of models with intervals, and paired comparisons with adjusted p-values.

A model has one prediction per seed. Its row is the mean of the metrics of its seeds, in the estimate as in every
resample, with their standard deviation over seeds (``n - 1``) beside it. A comparison takes the errors of each
group averaged over the seeds of a model::

    d_g = mean over seeds of left_g - mean over seeds of right_g        over the groups in which all are defined

All rows share the resamples, all comparisons the sign flips. The groups are put in the order of their ids first,
so the order in which they are given decides nothing.

Source: paper V-C (which averages seeds in two ways; errors reproduce its differences).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.derive.metric.bootstrap import NUM_RESAMPLES, Design, counted_mean, design
from branchdrive.derive.metric.family import Adjusted, Family, adjust
from branchdrive.derive.metric.interval import Intervals, intervals
from branchdrive.derive.metric.metric import METRICS, PAIRED_METRICS, MetricValues, metric_values
from branchdrive.derive.metric.outcome import Outcomes, Predictions
from branchdrive.derive.metric.scale import Scale
from branchdrive.derive.metric.sign_flip import NUM_FLIPS, draw_signs, sign_flip, studentised_p

__all__ = ["Comparison", "Contrast", "Estimate", "Interval", "Statistics", "compare", "statistics"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Interval(NamedTuple):
    """Ends of 95 %, percentile and BCa; NaN where there is none. `num_undefined` resamples lacked the metric."""

    low: float
    high: float
    bca_low: float
    bca_high: float
    num_undefined: int


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
        p: Two-sided sign-flip p-value; 1 where no group has both sides.
        is_smallest: Whether `p` is a bound: no flip reached the difference.
        studentised_p: Studentised bootstrap p-value, which assumes no symmetry.
        num_groups: Groups that have both sides.
    """

    name: str
    difference: float
    interval: Interval
    p: float
    is_smallest: bool
    studentised_p: float
    num_groups: int


class Statistics(NamedTuple):
    """All rows of a table; `adjusted` holds p-values by family and contrast."""

    estimates: tuple[Estimate, ...]
    comparisons: tuple[Comparison, ...]
    adjusted: Mapping[str, Mapping[str, Adjusted]]


def statistics(
    group_ids: Sequence[str],
    outcomes: Outcomes,
    predictions: Mapping[str, Mapping[int, Predictions]],
    scale: Scale,
    *,
    contrasts: Sequence[Contrast] = (),
    families: Sequence[Family] = (),
    seed: int,
    num_resamples: int = NUM_RESAMPLES,
    num_flips: int = NUM_FLIPS,
) -> Statistics:
    """Statistics of all models.

    Args:
        group_ids: Ids of the groups ``[N]``, the order of the first axis of outcomes and predictions.
        outcomes: What was recorded.
        predictions: By model and seed.
        scale: From the training partition.
        contrasts: Comparisons to make.
        families: Families of contrasts, by name.
        seed: Of resamples and sign flips.
        num_resamples: Resamples of the bootstrap.
        num_flips: Sign flips.

    Raises:
        ValueError: Groups do not match or repeat, a model has no prediction, a contrast names an unknown model or
            metric, or a family names an unknown contrast.
    """
    order = _order(group_ids, outcomes)
    owners = [(model, key) for model, by_seed in predictions.items() for key in sorted(by_seed)]
    for model, by_seed in predictions.items():
        if not by_seed:
            raise ValueError(f"model {model!r} has no prediction")
    resampling = design(len(order), seed=seed, num_resamples=num_resamples)
    given = [predictions[model][key].take(order) for model, key in owners]
    found = metric_values(outcomes.take(order), given, scale, resampling.counts) if given else None
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
        draw_signs(len(order), seed=seed, num_flips=num_flips),
    )
    adjusted = adjust(
        families,
        {row.name: row.p for row in comparisons},
        smallest={row.name for row in comparisons if row.is_smallest},
    )
    return Statistics(estimates, comparisons, adjusted)


def compare(names: Sequence[str], differences: Array, resampling: Design, signs: Array) -> tuple[Comparison, ...]:
    """Comparisons of paired differences ``[N, K]``, NaN where a group has none, under shared resamples and signs."""
    test = sign_flip(differences, signs)
    estimate, resamples, jackknife = resampling.split(counted_mean(resampling.counts, differences))
    ends = intervals(estimate, resamples, jackknife, test.num_groups)
    studentised = studentised_p(differences, resampling.counts[1 : 1 + resampling.num_resamples])
    return tuple(
        Comparison(
            name,
            float(test.mean[k]),
            _interval(ends, k),
            float(test.p[k]),
            bool(test.is_smallest[k]),
            float(studentised[k]),
            int(test.num_groups[k]),
        )
        for k, name in enumerate(names)
    )


def _order(group_ids: Sequence[str], outcomes: Outcomes) -> Index:
    if len(group_ids) != outcomes.num_groups or len(set(group_ids)) < len(group_ids):
        raise ValueError(
            f"{len(group_ids)} group ids, {len(set(group_ids))} of them distinct, do not name "
            f"{outcomes.num_groups} groups"
        )
    return np.array(sorted(range(len(group_ids)), key=group_ids.__getitem__), np.int64)


def _estimates(found: MetricValues, rows: Mapping[str, Sequence[int]], resampling: Design) -> tuple[Estimate, ...]:
    estimates = []
    for model, of_model in rows.items():
        by_seed = found.counted[of_model, 0]
        estimate, resamples, jackknife = resampling.split(found.counted[of_model].mean(axis=0))
        seed_sd = by_seed.std(axis=0, ddof=1) if len(of_model) > 1 else np.full(len(METRICS), np.nan)
        num_groups = found.num_groups[of_model].min(axis=0)
        ends = intervals(estimate, resamples, jackknife, num_groups)
        estimates += [
            Estimate(
                model,
                metric.name,
                float(estimate[m]),
                float(seed_sd[m]),
                tuple(by_seed[:, m].tolist()),
                _interval(ends, m),
                int(num_groups[m]),
            )
            for m, metric in enumerate(METRICS)
        ]
    return tuple(estimates)


def _difference(contrast: Contrast, by_group: Mapping[str, Array]) -> Array:
    unknown = [model for model in (contrast.left, contrast.right) if model not in by_group]
    if unknown or contrast.metric not in PAIRED_METRICS:
        name, known = (unknown[0], sorted(by_group)) if unknown else (contrast.metric, PAIRED_METRICS)
        raise ValueError(f"contrast {contrast.name!r} names {name!r}, which is none of {', '.join(known)}")
    place = [metric.name for metric in METRICS].index(contrast.metric)
    return np.asarray(by_group[contrast.left][:, place] - by_group[contrast.right][:, place])


def _interval(ends: Intervals, k: int) -> Interval:
    low, high, bca_low, bca_high, num_undefined = (field[k].item() for field in ends)
    return Interval(low, high, bca_low, bca_high, num_undefined)
