"""What becomes of the candidates that a selector takes: their outcomes, contacts, and losses against nominal.

With the shares ``w_ga`` of a selector, means over its seeds, and the outcomes ``y_gat`` of the ``N`` ranked groups::

    mean_t            = sum_ga w_ga y_gat / sum_ga w_ga     over the candidates whose target is available
    available_t       = 1 - sum_ga w_ga / N                 over the others
    contact           = sum_ga w_ga / N                     over those with a separation of at most the contact's
    avoidable contact = the same                            in groups with a candidate that makes none
    worse_t           = sum_ga w_ga / sum_ga w_ga           of those worse than nominal beyond the noise of repetition,
                                                            by those that can be compared with it

A mean has the intervals of every measure of a ranking. The others are rates of events that may be rare, of which a
bootstrap resamples nothing but zeros: they have the interval of `branchdrive.benchmark.ranking.ratio`, by clusters.
Shares of a choice are parts of an event, so that a rate over several seeds, or of a random choice, varies less than
that of single events, and its interval is at least as wide as it needs to be.

Source: paper, "Complete-Bank Ranking and Offline Policy Evaluation" (supplementary tables of selected primitive
outcomes); contacts, losses beyond noise and their intervals are this project's choice; spec/14-benchmark.md#ranking.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.metric.table import Interval
from branchdrive.benchmark.prediction.record import interval_record
from branchdrive.benchmark.ranking.noise import worse_beyond
from branchdrive.benchmark.ranking.ranking import SEPARATION
from branchdrive.benchmark.ranking.ratio import rate_interval
from branchdrive.driving.target import TARGETS, Targets
from branchdrive.driving.utility import TIE
from branchdrive.statistics.bca import ratio_intervals
from branchdrive.statistics.bootstrap import Design
from branchdrive.statistics.rounding import number

__all__ = ["Rate", "SelectedOutcomes", "rate", "selected_outcomes", "selected_record"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Rate(NamedTuple):
    """A share of selections with the ends of its interval by clusters; ``None`` where not defined."""

    value: float | None
    low: float | None
    high: float | None


class SelectedOutcomes(NamedTuple):
    """Outcomes of one selector's candidates; sequences are in the order of `TARGETS`.

    Attributes:
        means: In the units of the targets, NaN where no selected candidate has the target.
        available: Share of selections with the target.
        intervals: Of `means`.
        worse: Share that is worse than nominal beyond noise; ``None`` where the noise is unknown.
        contact: Share that makes contact.
        avoidable_contact: Share that does so although a candidate of the group does not.
    """

    means: Array
    available: Array
    intervals: tuple[Interval, ...]
    worse: tuple[Rate | None, ...]
    contact: Rate
    avoidable_contact: Rate


def selected_outcomes(
    outcomes: Targets,
    shares: Mapping[str, Array],
    ranked: Mask,
    resampling: Design,
    *,
    nominal: int,
    contact_m: float,
    tolerance: Array | None = None,
    settled: Collection[str] = (),
) -> dict[str, SelectedOutcomes]:
    """Outcomes of selectors over the ranked groups, by their names.

    Args:
        outcomes: Of all reported groups ``[groups, candidates, 6]``.
        shares: By selector, shares of the ranked groups ``[ranked groups, candidates]``.
        ranked: Which groups are ranked ``[groups]``; in these every candidate has a separation.
        resampling: Of all reported groups.
        nominal: Place of the nominal candidate.
        contact_m: A separation of at most so much is a contact, metres.
        tolerance: Noise of repetition of every target ``[6]``, NaN where unknown; ``None`` where nothing is known.
        settled: Selectors that lose nothing against nominal whatever the outcomes, as nominal itself.
    """
    there, place_of = outcomes.available[ranked], resampling.clusters.of_group[ranked]
    values = np.where(there, outcomes.values[ranked], 0.0)
    weights = {name: of_groups[..., None] * there for name, of_groups in shares.items()}
    sums = np.zeros((2, len(ranked), len(shares), len(TARGETS)))
    for place, each in enumerate(weights.values()):
        sums[:, ranked, place] = (each * values).sum(axis=1), each.sum(axis=1)
    above, under = sums.reshape(2, len(ranked), -1)
    means, ends = ratio_intervals(resampling, above, under, under > 0)
    touches = values[..., SEPARATION] <= contact_m + TIE
    avoidable = ~touches.all(axis=1)
    found = {}
    for place, (name, of_groups) in enumerate(shares.items()):
        columns = range(place * len(TARGETS), (place + 1) * len(TARGETS))
        contact, everyone = (of_groups * touches).sum(axis=1), np.ones(len(of_groups))
        found[name] = SelectedOutcomes(
            means[columns.start : columns.stop],
            1.0 - (of_groups[..., None] * ~there).sum(axis=(0, 1)) / len(of_groups),
            tuple(Interval.of(ends, column) for column in columns),
            _worse(values, there, weights[name], nominal, tolerance, place_of, has_interval=name not in settled),
            rate(contact, everyone, place_of),
            rate(contact * avoidable, everyone, place_of),
        )
    return found


def _worse(
    values: Array,
    there: Mask,
    weights: Array,
    nominal: int,
    tolerance: Array | None,
    place_of: NDArray[np.int64],
    *,
    has_interval: bool,
) -> tuple[Rate | None, ...]:
    """Rates of selections worse than nominal beyond noise ``[6]``, of arrays ``[groups, candidates, 6]``."""
    if tolerance is None:
        return (None,) * len(TARGETS)
    compared = weights * there[:, nominal, None]
    events = compared * worse_beyond(values - values[:, nominal, None], tolerance)
    both = zip(events.sum(axis=1).T, compared.sum(axis=1).T, strict=True)
    rates = [rate(*terms, place_of, has_interval=has_interval) for terms in both]
    return tuple(found if np.isfinite(noise) else None for found, noise in zip(rates, tolerance, strict=True))


def rate(events: Array, weights: Array, place_of: NDArray[np.int64], *, has_interval: bool = True) -> Rate:
    """Share of the weights that is of events, with the interval of a rate; shares of a choice are parts of an event.

    Args:
        events: Weight of the events ``[groups]``, at most that of the group.
        weights: ``[groups]``, at least 0.
        place_of: Cluster of every group ``[groups]``, counted from 0.
        has_interval: Whether the value does not follow from what a selection is.
    """
    if not (weights > 0).any():
        return Rate(None, None, None)
    value = float(events.sum() / weights.sum())
    return Rate(value, *rate_interval(events, weights, place_of)) if has_interval else Rate(value, None, None)


def selected_record(found: SelectedOutcomes) -> dict[str, Any]:
    """Outcomes as JSON data."""
    rows = [
        {
            "target": target.name,
            "mean": number(float(found.means[t])),
            "available": float(found.available[t]),
            "interval": interval_record(found.intervals[t]),
            "worse": None if (worse := found.worse[t]) is None else worse._asdict(),
        }
        for t, target in enumerate(TARGETS)
    ]
    return {
        "targets": rows,
        "contact": found.contact._asdict(),
        "avoidable_contact": found.avoidable_contact._asdict(),
    }
