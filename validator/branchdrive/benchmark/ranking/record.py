"""Results of rankings: every selector under every profile, and the families of tests between selectors.

Quantiles and ActionPrior come from the partition that models are fitted on, the fixed brake from the one that
choices are made on. All selectors share the resamples and sign flips of the reported groups, and of their route
clusters; a group that is not ranked has no difference.

Source: paper, "Complete-Bank Ranking and Offline Policy Evaluation"; spec/14-benchmark.md#results.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.inputs import ResultInputs
from branchdrive.benchmark.prediction.metric.ending import Endings
from branchdrive.benchmark.prediction.metric.table import Interval, compare, paired_difference
from branchdrive.benchmark.prediction.record import (
    comparison_record,
    evaluated_members,
    family_records,
    interval_record,
)
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol, Member
from branchdrive.benchmark.protocol.selection import CLEAN_ORACLE, ENSEMBLE, LEARNED, ORACLE
from branchdrive.benchmark.protocol.undeclared import undeclared_rankings
from branchdrive.benchmark.ranking.baseline import estimate, is_seen
from branchdrive.benchmark.ranking.context import Contexts
from branchdrive.benchmark.ranking.ending import ending_record, selected_endings
from branchdrive.benchmark.ranking.measure import Measures, best_fixed
from branchdrive.benchmark.ranking.noise import OutcomeNoise
from branchdrive.benchmark.ranking.ranking import Gate, Ranking, rank
from branchdrive.benchmark.ranking.ratio import Terms, figures
from branchdrive.benchmark.ranking.selected import selected_outcomes, selected_record
from branchdrive.driving.utility import RANGE, Scale, utility
from branchdrive.errors import DatasetError
from branchdrive.statistics.bca import Intervals, intervals, ratio_intervals
from branchdrive.statistics.bootstrap import Design, counted_mean
from branchdrive.statistics.rounding import number, numbers

__all__ = ["action_prior", "ranked_profile", "ranking_results", "scale_record"]

Array = NDArray[np.float64]

MEASURES = Measures._fields

HELD = ("value", "regret")
"""Measures in which learned selectors are held against references."""

_NOTHING, _OUTCOMES = "nothing", "outcomes"
_ORACLES = (ORACLE, CLEAN_ORACLE)


def action_prior(inputs: ResultInputs, profile: str) -> int:
    """Place of the candidate that ActionPrior takes under a profile: the best on the partition that is fitted on.

    Raises:
        ValueError: No group of that partition has all its utilities.
    """
    return best_fixed(utility(inputs.fitted.targets, inputs.utility_scale, inputs.protocol.preferences[profile]))


def ranking_results(
    inputs: ResultInputs, contexts: Contexts | None = None, noise: OutcomeNoise | None = None
) -> dict[str, Any]:
    """The section ``ranking``; outcomes of selections are in it where the protocol declares them.

    They tell how drives end where the model layer does.

    Raises:
        DatasetError: Baselines are declared, and what they see is not given.
    """
    protocol = inputs.protocol
    if protocol.baselines and contexts is None:
        raise DatasetError("the protocol declares baselines, which need the histories of the model layer")
    part, resampling = inputs.reported, inputs.resampling
    profiles: list[dict[str, Any]] = []
    left_out: list[dict[str, str]] = []
    rankings: dict[str, Ranking] = {}
    for name in protocol.preferences:
        try:
            ranking, about = ranked_profile(inputs, name, contexts)
        except ValueError as error:
            left_out.append({"profile": name, "reason": str(error)})
            continue
        rankings[name] = ranking
        added = _added_records(protocol, ranking, part.clusters)
        gates = _gate_records(protocol, {name: e.gate for name, e in ranking.entries.items()}, ranking, part.clusters)
        outcomes = _outcomes_records(inputs, ranking, noise)
        entries = [
            {**record, "gate": gates[selector], **added[selector], **outcomes[selector]}
            for selector, record in _entry_records(ranking, resampling).items()
        ]
        if (endings := _endings(inputs)) is not None:
            about["num_with_clean"] = int(endings.take(ranking.population.ranked).is_clean.any(axis=1).sum())
            for record, ends in zip(entries, _ending_records(inputs, endings, ranking), strict=True):
                record["outcomes"]["endings"] = ends
        profiles.append({"profile": name, **about, "entries": entries})
    families = protocol.of_kind("ranking")
    # Every profile ranks the same selectors.
    names = set(next(iter(rankings.values())).entries) if rankings else set()
    members = [member for member in evaluated_members(families, names) if member.profile in rankings]
    members += undeclared_rankings(protocol, inputs.judged, rankings)
    differences = [_difference(rankings, member) for member in members]
    comparisons = compare(
        [member.name for member in members],
        np.stack(differences, axis=1) if differences else np.empty((len(part.groups), 0)),
        resampling,
        seed=inputs.seed,
        num_flips=int(protocol.statistics.flips),
    )
    found = {
        **({} if protocol.outcomes is None else {"contact_m": protocol.outcomes.contact_m}),
        "profiles": profiles,
        "left_out": left_out,
        "comparisons": [comparison_record(comparison) for comparison in comparisons],
        "families": family_records(families, comparisons),
    }
    if protocol.selection is None:
        return found
    return found | {
        "unseen": [b.name for b in protocol.baselines if contexts is not None and not is_seen(b, contexts)],
        "held": [record for name, ranking in rankings.items() for record in _held_records(inputs, name, ranking)],
    }


def _held_records(inputs: ResultInputs, profile: str, ranking: Ranking) -> list[dict[str, Any]]:
    """Every learned selector against every declared reference, by value and by regret, under one profile."""
    protocol = inputs.protocol
    learned = [name for name in ranking.entries if name.startswith((LEARNED, ENSEMBLE))]
    references = () if protocol.selection is None else protocol.selection.references
    members = [
        Member(left=left, right=right, metric=metric, profile=profile)
        for left in learned
        for right in references
        if right in ranking.entries
        for metric in HELD
    ]
    if not members:
        return []
    comparisons = compare(
        [member.name for member in members],
        np.stack([_difference({profile: ranking}, member) for member in members], axis=1),
        inputs.resampling,
        seed=inputs.seed,
        num_flips=int(protocol.statistics.flips),
    )
    return [
        {**member.model_dump(mode="json"), **comparison_record(comparison)}
        for member, comparison in zip(members, comparisons, strict=True)
    ]


def ranked_profile(inputs: ResultInputs, name: str, contexts: Contexts | None) -> tuple[Ranking, dict[str, Any]]:
    """The ranking of the reported groups under a profile, and what is said of its population and constants.

    Raises:
        ValueError: No group can be ranked, or none of training has all its utilities.
    """
    protocol, data, scale = inputs.protocol, inputs.data, inputs.utility_scale
    partitions, profile = protocol.partitions, protocol.preferences[name]
    prior = action_prior(inputs, name)
    brake = None
    if data.brakes and partitions.select in data.parts:
        brake = best_fixed(utility(data.parts[partitions.select].targets, scale, profile), data.brakes)
    utilities = utility(inputs.fitted.targets, scale, profile)
    ranking = rank(
        inputs.reported.targets,
        {model: inputs.predictions.scalars(model, partitions.report) for model in inputs.judged},
        scale=scale,
        profile=profile,
        nominal=data.nominal,
        action_prior=prior,
        fixed_brake=brake,
        baselines={
            baseline.name: estimate(baseline, contexts, inputs.fitted.groups, utilities, inputs.reported.groups)
            for baseline in protocol.baselines
            if contexts is not None and is_seen(baseline, contexts)
        },
        ensembles=protocol.selection is not None and protocol.selection.ensembles,
        clean=None if (endings := _endings(inputs)) is None else endings.is_clean,
    )
    who = ranking.population
    return ranking, {
        "num_ranked": int(who.ranked.sum()),
        "num_without_separation": who.num_without_separation,
        "num_without_other": who.num_without_other,
        "num_without_range": ranking.num_without_range,
        "action_prior": data.candidates[prior],
        "fixed_brake": None if brake is None else data.candidates[brake],
    }


def _entry_records(ranking: Ranking, resampling: Design) -> dict[str, dict[str, Any]]:
    """Every selector with its measures and their intervals, by its name."""
    entries = ranking.entries
    values = np.stack(
        [_spread_out(getattr(entry.measures, name), ranking) for entry in entries.values() for name in MEASURES], axis=1
    )
    there = ~np.isnan(values)
    means, ends = ratio_intervals(resampling, np.where(there, values, 0.0), there.astype(np.float64), there)
    captured = _captured_intervals(ranking, resampling)
    found = {}
    for place, (selector, entry) in enumerate(entries.items()):
        column_of = {name: place * len(MEASURES) + i for i, name in enumerate(MEASURES)}
        seed_means = [[float(getattr(seed, name).mean()) for seed in entry.seeds] for name in ("value", "regret")]
        found[selector] = {
            "selector": selector,
            **{name: number(means[column]) for name, column in column_of.items()},
            "intervals": {name: _record(ends, column) for name, column in column_of.items()},
            "seed_sd": {
                name: number(float(np.std(of_seeds, ddof=1))) if len(of_seeds) > 1 else None
                for name, of_seeds in zip(("value", "regret"), seed_means, strict=True)
            },
            "agreement": None if entry.agreement is None else float(entry.agreement.mean()),
            "num_actions": list(entry.num_actions),
            "captured": number(entry.captured),
            "captured_interval": None if entry.captured is None else captured[selector],
        }
    return found


def _outcomes_records(inputs: ResultInputs, ranking: Ranking, noise: OutcomeNoise | None) -> dict[str, dict[str, Any]]:
    """What selectors have beside their measures: nothing where the protocol does not declare outcomes."""
    declared = inputs.protocol.outcomes
    if declared is None:
        return {name: {} for name in ranking.entries}
    found = selected_outcomes(
        inputs.reported.targets,
        {name: entry.shares for name, entry in ranking.entries.items()},
        ranking.population.ranked,
        inputs.resampling,
        nominal=inputs.data.nominal,
        contact_m=declared.contact_m,
        tolerance=None if noise is None else noise.tolerance,
        settled=("nominal",),
    )
    return {name: {"outcomes": selected_record(outcomes)} for name, outcomes in found.items()}


def _endings(inputs: ResultInputs) -> Endings | None:
    """Endings of the reported groups; ``None`` where they are not there, or the protocol declares no outcomes."""
    return None if inputs.protocol.outcomes is None else inputs.reported.endings


def _ending_records(inputs: ResultInputs, endings: Endings, ranking: Ranking) -> list[dict[str, Any]]:
    """How the drives of every selector's candidates end, in the order of the entries."""
    found = selected_endings(
        endings,
        {name: entry.shares for name, entry in ranking.entries.items()},
        ranking.population.ranked,
        inputs.resampling,
        nominal=inputs.data.nominal,
        seed=inputs.seed,
    )
    return [ending_record(ends) for ends in found.values()]


def _added_records(protocol: BenchmarkProtocol, ranking: Ranking, clusters: Sequence[str]) -> dict[str, dict[str, Any]]:
    """What a protocol with a `selection` has of every selector besides; nothing under another."""
    if protocol.selection is None:
        return {name: {} for name in ranking.entries}
    gates = {name: entry.gate_to_nominal for name, entry in ranking.entries.items()}
    to_nominal = _gate_records(protocol, gates, ranking, clusters)
    return {
        name: {"sees": _sees(protocol, name), "is_tie": entry.is_tie, "gate_to_nominal": to_nominal[name]}
        for name, entry in ranking.entries.items()
    }


def _sees(protocol: BenchmarkProtocol, selector: str) -> str | None:
    """What a selector may see of a group; ``None`` for a model that the protocol does not declare."""
    if selector.startswith((LEARNED, ENSEMBLE)):
        model = protocol.model(selector.removeprefix(LEARNED).removeprefix(ENSEMBLE))
        return None if model is None else f"{model.contract} inputs"
    sees = {baseline.name: baseline.sees for baseline in protocol.baselines}
    return sees.get(selector, _OUTCOMES if selector in _ORACLES else _NOTHING)


def _gate_records(
    protocol: BenchmarkProtocol, gates: Mapping[str, Gate], ranking: Ranking, clusters: Sequence[str]
) -> dict[str, dict[str, Any]]:
    """Gates by selector, with intervals that resample the route clusters of ranked groups."""
    ranked = [cluster for cluster, takes_part in zip(clusters, ranking.population.ranked, strict=True) if takes_part]
    terms = {name: Terms(gate.difference_m, np.ones(len(ranked))) for name, gate in gates.items()}
    found = figures(terms, ranked, seed=int(protocol.statistics.seed), num_resamples=int(protocol.statistics.resamples))
    return {
        name: {
            "mean_m": gate.mean_m,
            "low": number(found[name].low),
            "high": number(found[name].high),
            "passed": bool(gate.passed),
        }
        for name, gate in gates.items()
    }


def _captured_intervals(ranking: Ranking, resampling: Design) -> dict[str, dict[str, Any]]:
    """Of the captured shares: ratios of means over groups, resampled on both sides at once."""
    differences = [_spread_out(entry.measures.difference, ranking) for entry in ranking.entries.values()]
    means = counted_mean(resampling, np.stack(differences, axis=1))
    gap = means[:, [list(ranking.entries).index("oracle")]]
    shares = np.divide(means, gap, out=np.full_like(means, np.nan), where=gap > RANGE)
    ranked = ranking.population.ranked[:, None]
    units = ranked.sum(axis=0), resampling.clusters.num_there(ranked)
    return {
        name: _record(intervals(*resampling.split(shares[:, [place]]), *units), 0)
        for place, name in enumerate(ranking.entries)
    }


def _spread_out(values: Array, ranking: Ranking) -> Array:
    """Values of the ranked groups at the places of all reported groups, NaN elsewhere."""
    spread_out = np.full(len(ranking.population.ranked), np.nan)
    spread_out[ranking.population.ranked] = values
    return spread_out


def _difference(rankings: Mapping[str, Ranking], member: Member) -> Array:
    ranking = rankings[str(member.profile)]
    left, right = (
        _spread_out(getattr(ranking.entries[name].measures, member.metric), ranking)
        for name in (member.left, member.right)
    )
    return paired_difference(left, right)


def _record(ends: Intervals, k: int) -> dict[str, Any]:
    return interval_record(Interval.of(ends, k))


def scale_record(scale: Scale) -> dict[str, Any]:
    """Quantiles as JSON data."""
    return {"q05": numbers(scale.q05.tolist()), "q95": numbers(scale.q95.tolist())}
