"""The whole ranking of one profile: all selectors on the groups of one partition.

A group in which a candidate has no utility, as when its separation is unavailable, leaves the ranking and
is counted. What was fitted elsewhere comes as arguments: quantiles and ActionPrior from training, the fixed
brake from validation.

Source: paper VI-D.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.ranking.comparison import Gate, captured_share, non_worsening, seed_agreement
from branchdrive.benchmark.ranking.measure import Measures, mean_measures, measures, without_range
from branchdrive.benchmark.ranking.selector import LEARNED, Selector, by_score, fixed, uniform
from branchdrive.driving.target import TARGETS, Targets
from branchdrive.driving.utility import Profile, Scale, predicted_utility, utility

__all__ = ["SEPARATION", "Entry", "Population", "Ranking", "population", "rank"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SEPARATION = [target.name for target in TARGETS].index("min_separation_m")
"""Place of the minimum separation on the axis of targets."""


class Population(NamedTuple):
    """Who is ranked.

    Attributes:
        ranked: ``[groups]``, whether all candidates have a utility.
        num_without_separation: Groups that leave because a separation is unavailable.
        num_without_other: Groups that leave because another weighed target is.
    """

    ranked: Mask
    num_without_separation: int
    num_without_other: int


class Entry(NamedTuple):
    """One selector.

    Attributes:
        measures: By group, means over seeds.
        seeds: By seed; one for a selector that learns nothing.
        shares: Mean shares over seeds ``[groups, candidates]``.
        agreement: Agreement of the seeds ``[groups]``; `None` for fewer than two.
        num_actions: Distinct candidates chosen, by seed; for Random all of them.
        captured: Captured share of the oracle gap; `None` where there is no gap.
        gate: Non-worsening of separation against ActionPrior.
    """

    measures: Measures
    seeds: tuple[Measures, ...]
    shares: Array
    agreement: Array | None
    num_actions: tuple[int, ...]
    captured: float | None
    gate: Gate


class Ranking(NamedTuple):
    """All selectors on one partition under one profile.

    Attributes:
        population: Who is ranked; everything else is over these groups, in their order.
        utilities: Executed utilities ``[ranked groups, candidates]``.
        num_without_range: Groups whose utilities are all equal.
        entries: Selectors by name: ``random``, ``nominal``, ``action_prior``, ``fixed_brake``, ``O-`` and the name
            of a model, ``oracle``.
    """

    population: Population
    utilities: Array
    num_without_range: int
    entries: Mapping[str, Entry]


def population(outcomes: Targets, utilities: Array) -> Population:
    """Which groups are ranked, from outcomes ``[groups, candidates, 6]`` and utilities ``[groups, candidates]``."""
    ranked = np.asarray(np.isfinite(utilities).all(axis=1))
    no_separation = ~outcomes.available[..., SEPARATION].all(axis=1)
    return Population(ranked, int(no_separation.sum()), int((~ranked & ~no_separation).sum()))


def rank(
    outcomes: Targets,
    predictions: Mapping[str, Array],
    *,
    scale: Scale,
    profile: Profile,
    nominal: int,
    action_prior: int,
    fixed_brake: int | None = None,
) -> Ranking:
    """Rank the candidates of every group by every selector.

    Args:
        outcomes: Executed targets ``[groups, candidates, 6]``.
        predictions: By model, predicted targets ``[seeds, groups, candidates, 6]``, one selection for each seed.
        scale: Quantiles of the training partition.
        profile: What is preferred.
        nominal: Place of the nominal candidate.
        action_prior: Candidate with the greatest mean utility in training, see `best_fixed`.
        fixed_brake: Brake candidate chosen on validation; `None` for a bank without one.

    Raises:
        ValueError: Shapes do not match, a prediction is not finite, or no group can be ranked.
    """
    everyone = utility(outcomes, scale, profile)
    who = population(outcomes, everyone)
    utilities = everyone[who.ranked]
    if not len(utilities):
        raise ValueError(f"none of {len(everyone)} groups can be ranked: each lacks a utility")
    shape = utilities.shape
    selectors: dict[str, list[Selector]] = {
        "random": [uniform(*shape)],
        "nominal": [fixed(nominal, *shape)],
        "action_prior": [fixed(action_prior, *shape)],
    }
    if fixed_brake is not None:
        selectors["fixed_brake"] = [fixed(fixed_brake, *shape)]
    for model, scalars in predictions.items():
        if scalars.ndim != 4 or not len(scalars) or scalars.shape[1:] != outcomes.values.shape:
            raise ValueError(
                f"predictions of {model!r} have shape {list(scalars.shape)}, expected "
                f"[seeds, {', '.join(map(str, outcomes.values.shape))}]"
            )
        scores = predicted_utility(scalars, scale, profile)[:, who.ranked]
        selectors[LEARNED + model] = [by_score(each) for each in scores]
    oracle = by_score(utilities)
    selectors["oracle"] = [oracle]
    best = measures(oracle, utilities, nominal=nominal)
    separation = outcomes.values[who.ranked, :, SEPARATION]
    entries = {
        name: _entry(seeds, utilities, separation, best, nominal=nominal, reference=action_prior)
        for name, seeds in selectors.items()
    }
    return Ranking(who, utilities, without_range(utilities), entries)


def _entry(
    selectors: list[Selector], utilities: Array, separation: Array, oracle: Measures, *, nominal: int, reference: int
) -> Entry:
    seeds = tuple(measures(each, utilities, nominal=nominal) for each in selectors)
    mean = mean_measures(seeds)
    all_shares = np.stack([each.shares for each in selectors])
    shares = all_shares.mean(axis=0)
    return Entry(
        measures=mean,
        seeds=seeds,
        shares=shares,
        agreement=seed_agreement(all_shares) if len(selectors) > 1 else None,
        num_actions=tuple(int((each > 0).any(axis=0).sum()) for each in all_shares),
        captured=captured_share(mean, oracle),
        gate=non_worsening(separation, all_shares, reference),
    )
