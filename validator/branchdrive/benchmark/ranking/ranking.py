"""The whole ranking of one profile: all selectors on the groups of one partition.

A group in which a candidate has no utility, as when its separation is unavailable, leaves the ranking and
is counted. What was fitted elsewhere comes as arguments: quantiles and ActionPrior from training, the fixed
brake from validation.

Source: paper, "Complete-Bank Ranking and Offline Policy Evaluation".

Selectors against each other: captured share of the oracle gap, agreement of seeds, the non-worsening gate.

::

    captured share = sum_g (value - nominal) / sum_g (oracle - nominal)
    agreement_g    = share of the pairs of seeds that choose the same candidate in group g
    gate fails iff   mean_g mean_s (separation of the choice - separation of the reference) < -TIE

Source: paper, "Complete-Bank Ranking and Offline Policy Evaluation" and "Conservative Calibration and Deployment
Boundary".
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations, islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.protocol.selection import CLEAN_ORACLE, ENSEMBLE, LEARNED, ORACLE
from branchdrive.benchmark.ranking.measure import (
    Measures,
    Selector,
    by_score,
    fixed,
    mean_measures,
    measures,
    uniform,
    without_range,
)
from branchdrive.driving.target import TARGETS, Targets
from branchdrive.driving.utility import RANGE, TIE, Profile, Scale, predicted_utility, utility

__all__ = [
    "SEPARATION",
    "Entry",
    "Gate",
    "Population",
    "Ranking",
    "captured_share",
    "non_worsening",
    "population",
    "rank",
    "seed_agreement",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SEPARATION = [target.name for target in TARGETS].index("min_separation_m")
"""Place of the minimum separation on the axis of targets."""


_GROUPS_AT_ONCE = 1 << 12
"""Groups of all selectors that are measured together: 3 MiB for each array over pairs of candidates."""

_CLEAN_FIRST = 2.0
"""More than utilities, which are at most 1, can differ."""


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
        gate_to_nominal: The same against nominal.
        is_tie: Whether all scores tie in every group, so that the order of the bank decides and nothing else; not
            where candidates share the choice.
    """

    measures: Measures
    seeds: tuple[Measures, ...]
    shares: Array
    agreement: Array | None
    num_actions: tuple[int, ...]
    captured: float | None
    gate: Gate
    gate_to_nominal: Gate
    is_tie: bool


class Ranking(NamedTuple):
    """All selectors on one partition under one profile.

    Attributes:
        population: Who is ranked; everything else is over these groups, in their order.
        utilities: Executed utilities ``[ranked groups, candidates]``.
        num_without_range: Groups whose utilities are all equal.
        entries: Selectors by name: ``random``, ``nominal``, ``action_prior``, ``fixed_brake``, baselines, ``O-`` and
            the name of a model, ``E-`` and the name of a model, ``oracle``, and `CLEAN_ORACLE` where ends are known.
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
    baselines: Mapping[str, Array] | None = None,
    ensembles: bool = False,
    clean: Mask | None = None,
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
        baselines: Utilities that baselines estimate ``[groups, candidates]``, by name.
        ensembles: Whether the mean prediction of a model of several seeds selects too.
        clean: Drives that are known to be clean to their end ``[groups, candidates]``; with them selects
            `CLEAN_ORACLE` too, the oracle among clean drives.

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
    selectors |= {name: [by_score(scores[who.ranked])] for name, scores in (baselines or {}).items()}
    for model, scalars in predictions.items():
        if scalars.ndim != 4 or not len(scalars) or scalars.shape[1:] != outcomes.values.shape:
            raise ValueError(
                f"predictions of {model!r} have shape {list(scalars.shape)}, expected "
                f"[seeds, {', '.join(map(str, outcomes.values.shape))}]"
            )
        scores = predicted_utility(scalars, scale, profile)[:, who.ranked]
        selectors[LEARNED + model] = [by_score(each) for each in scores]
        if ensembles and len(scores) > 1:
            mean = predicted_utility(scalars.mean(axis=0), scale, profile)[who.ranked]
            selectors[ENSEMBLE + model] = [by_score(mean)]
    oracle = by_score(utilities)
    selectors[ORACLE] = [oracle]
    if clean is not None:
        selectors[CLEAN_ORACLE] = [by_score(utilities + _CLEAN_FIRST * clean[who.ranked])]
    best = measures(oracle, utilities, nominal=nominal)
    separation = outcomes.values[who.ranked, :, SEPARATION]
    measured = iter(_measured([each for seeds in selectors.values() for each in seeds], utilities, nominal))
    entries = {
        name: _entry(
            seeds, tuple(islice(measured, len(seeds))), separation, best, nominal=nominal, reference=action_prior
        )
        for name, seeds in selectors.items()
    }
    return Ranking(who, utilities, without_range(utilities), entries)


def _measured(selectors: list[Selector], utilities: Array, nominal: int) -> list[Measures]:
    """Measures of every selector; those of few groups are computed together."""
    found: list[Measures] = []
    at_once = max(1, _GROUPS_AT_ONCE // len(utilities))
    for start in range(0, len(selectors), at_once):
        part = selectors[start : start + at_once]
        joined = Selector(*map(np.concatenate, zip(*part, strict=True)))
        of_part = measures(joined, np.tile(utilities, (len(part), 1)), nominal=nominal)
        found += map(Measures._make, zip(*(np.split(field, len(part)) for field in of_part), strict=True))
    return found


def _entry(
    selectors: list[Selector],
    seeds: tuple[Measures, ...],
    separation: Array,
    oracle: Measures,
    *,
    nominal: int,
    reference: int,
) -> Entry:
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
        gate_to_nominal=non_worsening(separation, all_shares, nominal),
        is_tie=all(_is_tie(each) for each in selectors),
    )


def _is_tie(selector: Selector) -> bool:
    return bool((np.ptp(selector.scores, axis=1) <= TIE).all() and (selector.shares.max(axis=1) == 1).all())


class Gate(NamedTuple):
    """Outcome of the non-worsening gate.

    Attributes:
        difference_m: Separation of the choice minus that of the reference ``[groups]``, metres.
        mean_m: Their mean, metres.
        passed: Whether the mean is not negative, but for rounding.
    """

    difference_m: Array
    mean_m: float
    passed: bool


def captured_share(found: Measures, oracle: Measures) -> float | None:
    """Part of the gap from nominal to oracle that a selector gains; `None` where the mean gap is at most `RANGE`.

    A ratio of means over groups: a bootstrap resamples `Measures.difference` of both.
    """
    gap = float(oracle.difference.mean())
    return float(found.difference.mean()) / gap if gap > RANGE else None


def seed_agreement(shares: Array) -> Array:
    """Agreement of the seeds ``[groups]``.

    Args:
        shares: One-hot choices ``[seeds, groups, candidates]``, at least two seeds.

    Raises:
        ValueError: There are fewer than two seeds.
    """
    if len(shares) < 2:
        raise ValueError(f"{len(shares)} seed has nothing to agree with; give at least two")
    chosen = shares.argmax(axis=2)
    agree = [chosen[one] == chosen[other] for one, other in combinations(range(len(shares)), 2)]
    return np.asarray(np.mean(agree, axis=0))


def non_worsening(separation_m: Array, shares: Array, reference: int) -> Gate:
    """The gate of one selector, against a candidate that is always the same.

    Args:
        separation_m: Executed minimum separation ``[groups, candidates]``, metres, of ranked groups.
        shares: Shares of the selector ``[seeds, groups, candidates]``; a seed that chooses another candidate of the
            same separation as the reference differs from it by nothing.
        reference: That candidate: what ActionPrior takes, or nominal.

    Raises:
        ValueError: There is no group, or a separation is not a number.
    """
    if not separation_m.size or not np.isfinite(separation_m).all():
        raise ValueError("the gate needs groups in which every candidate has a separation")
    difference = (shares * (separation_m - separation_m[:, reference, None])).sum(axis=2).mean(axis=0)
    mean = float(difference.mean())
    return Gate(difference, mean, mean >= -TIE)
