"""How the drives of the candidates end that a selector takes, and whether they end worse than nominal's.

A drive is what was recorded of a candidate from its start to its end: after the window it goes on under the expert's
policy, with whatever the candidate has led to. With the shares ``w_ga`` of a selector, means over its seeds, the events
``e_ga`` of drives, and ``k_ga`` where an event was monitored, over ``N`` ranked groups::

    share of an event     = sum_ga w_ga k_ga e_ga / sum_ga w_ga k_ga
    clean                 = the same of drives without a collision, a departure from the road or an infraction
    route                 = sum_ga w_ga f_ga / N                                 of the shares f of routes
    less nominal's        = sum_ga w_ga k_ga k_g0 (e_ga - e_g0) / sum_ga w_ga k_ga k_g0

Shares have the interval of a rate by clusters, the share of routes that of every measure of a ranking, and differences
those of the gate.

Source: this project's choice; spec/14-benchmark.md#endings.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.metric.ending import EVENTS, Endings
from branchdrive.benchmark.prediction.metric.table import Interval
from branchdrive.benchmark.prediction.record import interval_record
from branchdrive.benchmark.ranking.ratio import Figure, Terms, figures
from branchdrive.benchmark.ranking.selected import Rate, rate
from branchdrive.statistics.bca import intervals
from branchdrive.statistics.bootstrap import Design, counted_mean
from branchdrive.statistics.rounding import number

__all__ = ["COMPARED", "RATES", "SelectedEndings", "ending_record", "selected_endings"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

COMPARED = ("clean", "completed")
"""Good ends, of which nominal's share is subtracted."""

RATES = (*EVENTS, *COMPARED)
"""Shares of selections, in order."""


class SelectedEndings(NamedTuple):
    """Ends of the drives of one selector's candidates.

    Attributes:
        rates: By `RATES`.
        known: Share of selections of which it is known whether their drive is clean.
        route_fraction: Mean share of routes.
        interval: Of it.
        to_nominal: By `COMPARED`, the share less that of nominal in the same groups.
    """

    rates: Mapping[str, Rate]
    known: float
    route_fraction: float
    interval: Interval
    to_nominal: Mapping[str, Figure]


def selected_endings(
    endings: Endings, shares: Mapping[str, Array], ranked: Mask, resampling: Design, *, nominal: int, seed: int
) -> dict[str, SelectedEndings]:
    """Ends of the drives of every selector, by its name, over the ranked groups.

    Args:
        endings: Of all reported groups ``[groups, candidates]``.
        shares: By selector, shares of the ranked groups ``[ranked groups, candidates]``.
        ranked: Which groups are ranked ``[groups]``.
        resampling: Of all reported groups.
        nominal: Place of the nominal candidate.
        seed: Of the intervals of differences, which have as many resamples.
    """
    found, place_of = endings.take(ranked), resampling.clusters.of_group[ranked]
    happened = {event: found.events[..., i] for i, event in enumerate(EVENTS)}
    happened |= {"clean": found.is_clean, "completed": found.completed}
    known = {event: found.monitored[..., i] for i, event in enumerate(EVENTS)}
    known |= {"clean": found.is_known, "completed": np.ones_like(found.completed)}
    terms: dict[str, Terms] = {}
    for name, weights in shares.items():
        for end in COMPARED:
            compared = weights * known[end] * known[end][:, nominal, None]
            gained = happened[end].astype(np.float64) - happened[end][:, nominal, None]
            terms[f"{name} {end}"] = Terms((compared * gained).sum(axis=1), compared.sum(axis=1))
    names = [str(resampling.clusters.names[place]) for place in place_of.tolist()]
    differences = figures(terms, names, seed=seed, num_resamples=resampling.num_resamples)

    def of_selector(name: str, weights: Array) -> SelectedEndings:
        rates = {
            end: rate((weights * known[end] * happened[end]).sum(axis=1), (weights * known[end]).sum(axis=1), place_of)
            for end in RATES
        }
        driven = np.full(len(ranked), np.nan)
        driven[ranked] = (weights * found.route_fraction).sum(axis=1)
        parts = resampling.split(counted_mean(resampling, driven[:, None]))
        ends = intervals(*parts, ranked[:, None].sum(axis=0), resampling.clusters.num_there(ranked[:, None]))
        return SelectedEndings(
            rates,
            float((weights * known["clean"]).sum() / len(weights)),
            float(parts[0][0]),
            Interval.of(ends, 0),
            {end: differences[f"{name} {end}"] for end in COMPARED},
        )

    return {name: of_selector(name, weights) for name, weights in shares.items()}


def ending_record(found: SelectedEndings) -> dict[str, Any]:
    """Ends as JSON data."""
    return {
        **{name: found.rates[name]._asdict() for name in RATES},
        "known": found.known,
        "route_fraction": {"mean": number(found.route_fraction), "interval": interval_record(found.interval)},
        "to_nominal": {
            end: {"value": number(one.value), "low": number(one.low), "high": number(one.high)}
            for end, one in found.to_nominal.items()
        },
    }
