"""Figures of a run: what drives came to by arm, against nominal's of the same groups, and beside offline figures.

With drives ``g`` of an arm, events ``e_g`` where they were monitored ``k_g``, ways ``w_g`` in kilometres, and ``n_g``
counts of events::

    share of drives with an event   sum k e / sum k      interval of Clopper and Pearson by route clusters
    events a kilometre              sum k n / sum k w    percentiles over resamples of route clusters
    score, share of route, comfort  means                percentiles over resamples of route clusters

Differences are to the nominal arm of the same schedule and condition, group by group; those of collisions are over the
groups in which both drives were monitored, and without one the gate is neither passed nor failed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.ranking.measure import by_score, measures
from branchdrive.benchmark.ranking.ratio import Figure, Terms, figures
from branchdrive.driving.target import TARGETS
from branchdrive.driving.utility import TIE
from branchdrive.statistics.cluster import Clusters
from branchdrive.statistics.holm import holm
from branchdrive.statistics.sign_flip import CLUSTER_STREAM, draw_signs, sign_flip
from branchdrive_reference.closed_loop.arm import CONDITIONS, Arm
from branchdrive_reference.closed_loop.correlation import correlations
from branchdrive_reference.closed_loop.look_ahead import executed_utilities, look_ahead_results
from branchdrive_reference.closed_loop.selector import Training

__all__ = ["EVENTS", "OFFLINE", "drive_results"]

Array = NDArray[np.float64]
Document = Mapping[str, Any]

EVENTS = ("collision", "off_road", "infraction")
"""Events of a drive."""

SHARES = (*EVENTS, "clean", "completed", "collision_in_first_window", "collision_later", "first_intervention")
"""Shares of drives."""

MEANS = ("route_fraction", "score", "mean_jerk_mps3", "max_accel_mps2", "max_yaw_rate_radps", "interventions")

OFFLINE = ("value", "regret", "contact")
"""Offline figures of the first choice; of the last two, lower is better.

A contact is a separation of 0 from an actor in a saved frame, so that a collision with a wall is none.
"""

_COUNTS: Mapping[str, tuple[str, ...]] = {
    "collision": ("pedestrian_collisions", "vehicle_collisions", "static_collisions"),
    "off_road": ("off_road_infractions",),
    "infraction": ("red_light_infractions", "stop_sign_infractions"),
}
_SEPARATION = [target.name for target in TARGETS].index("min_separation_m")


def drive_results(
    groups: Sequence[Document],
    clusters: Mapping[str, str],
    arms: Sequence[Arm],
    training: Training,
    *,
    statistics: Mapping[str, int],
    warnings: Sequence[str],
) -> dict[str, Any]:
    """Figures as JSON data.

    Args:
        groups: Files of all groups.
        clusters: Route cluster by the id of a group.
        arms: What was driven in each.
        training: What offline figures are weighed by.
        statistics: Seed, resamples and flips.
        warnings: Sentences that tables carry.
    """
    driven = [group for group in groups if group["left_out_because"] is None]
    left_out = Counter(group["left_out_because"] for group in groups if group["left_out_because"] is not None)
    document: dict[str, Any] = {
        "num_planned": len(groups),
        "num_driven": len(driven),
        "num_clusters": len({clusters[group["group_id"]] for group in driven}),
        "left_out": dict(sorted(left_out.items())),
        "profile": training.profile_name,
        "warnings": list(warnings),
        "arms": [],
        "offline": None,
        "correlations": [],
    }
    if not driven:
        return document
    names = [clusters[group["group_id"]] for group in driven]
    drives = [[group["drives"][i] for group in driven] for i in range(len(arms))]
    document["arms"] = _arms(drives, names, arms, statistics)
    if all(group["banks"] is not None for group in driven):
        ahead = look_ahead_results(driven, names, arms, training, statistics)
        document["arms"] = [{**arm, "look_ahead": one} for arm, one in zip(document["arms"], ahead, strict=True)]
    document |= _offline(driven, names, arms, training, statistics)
    return document


def _column(drives: Sequence[Document], name: str) -> Array:
    return np.array([np.nan if drive[name] is None else drive[name] for drive in drives], np.float64)


def _counted(drives: Sequence[Document], event: str) -> tuple[Array, Array]:
    """Counts of an event, and whether all of them were monitored."""
    found = [[drive["counts"][name] for name in _COUNTS[event]] for drive in drives]
    known = np.array([all(count is not None for count in counts) for counts in found], np.float64)
    return np.array([sum(count or 0 for count in counts) for counts in found], np.float64), known


def _shares(drives: Sequence[Document]) -> dict[str, Terms]:
    """Shares of `SHARES` as numerators and denominators."""
    terms, ones = {}, np.ones(len(drives))
    clean, all_known = np.ones(len(drives)), np.ones(len(drives))
    for event in EVENTS:
        counts, known = _counted(drives, event)
        happened = (counts > 0).astype(np.float64)
        terms[event] = Terms(happened * known, known)
        clean, all_known = clean * (1 - happened), all_known * known
    terms["clean"] = Terms(clean * all_known, all_known)
    flags = {
        "completed": [drive["completion"] == "completed" for drive in drives],
        "first_intervention": [_intervenes(drive["choices"][:1]) for drive in drives],
        **{name: [drive[name] for drive in drives] for name in ("collision_in_first_window", "collision_later")},
    }
    return terms | {name: Terms(np.array(values, np.float64), ones) for name, values in flags.items()}


def _intervenes(keys: Sequence[str]) -> bool:
    return any(key != "nominal" for key in keys)


def _arms(
    drives: Sequence[Sequence[Document]], names: Sequence[str], arms: Sequence[Arm], statistics: Mapping[str, int]
) -> list[dict[str, Any]]:
    terms: dict[str, Terms] = {}
    rates: list[str] = []
    references = [_reference(arms, arm) for arm in arms]
    ones, shares = np.ones(len(names)), [_shares(found) for found in drives]
    for i, found in enumerate(drives):
        way_km = _column(found, "way_km")
        terms |= {f"{i} {name}": term for name, term in shares[i].items()}
        rates += [f"{i} {name}" for name in shares[i]]
        for event in EVENTS:
            counts, known = _counted(found, event)
            terms[f"{i} {event} a km"] = Terms(counts * known, way_km * known)
        for name in MEANS:
            values = _column(found, name)
            there = np.isfinite(values).astype(np.float64)
            terms[f"{i} {name}"] = Terms(np.where(there > 0, values, 0.0), there)
        other = drives[references[i]]
        hit, hit_nominal = (shares[arm]["collision"] for arm in (i, references[i]))
        both = hit.denominator * hit_nominal.denominator  # monitored in both drives
        more = hit.numerator - hit_nominal.numerator
        terms[f"{i} score to nominal"] = Terms(_column(found, "score") - _column(other, "score"), ones)
        terms[f"{i} collision to nominal"] = Terms(more * both, both)
        terms[f"{i} worse"] = Terms((more > 0) * both, both)
        terms[f"{i} better"] = Terms((more < 0) * both, both)
        rates += [f"{i} worse", f"{i} better"]
    found_figures = figures(terms, names, seed=statistics["seed"], num_resamples=statistics["resamples"], rates=rates)
    tests = _tests(drives, names, arms, references, statistics)

    def figure(i: int, name: str) -> dict[str, float | None]:
        return _figure(found_figures[f"{i} {name}"])

    documents = []
    for i, (arm, found) in enumerate(zip(arms, drives, strict=True)):
        gate = figure(i, "collision to nominal")
        documents.append(
            {
                **arm.document,
                "way_km": float(_column(found, "way_km").sum()),
                "shares": {name: figure(i, name) for name in SHARES},
                "events_a_km": {event: figure(i, f"{event} a km") for event in EVENTS},
                "means": {name: figure(i, name) for name in MEANS},
                "first_choices": dict(Counter(key for drive in found for key in drive["choices"][:1]).most_common()),
                "later_choices": dict(Counter(key for drive in found for key in drive["choices"][1:]).most_common()),
                "to_nominal": None
                if arm.is_nominal
                else {
                    "score": {**figure(i, "score to nominal"), **tests[i]},
                    "collision": gate,
                    "worse": figure(i, "worse"),
                    "better": figure(i, "better"),
                    "gate_passed": None if gate["value"] is None else gate["value"] <= TIE,
                },
            }
        )
    return documents


def _figure(found: Figure) -> dict[str, float | None]:
    return {"value": found.value, "low": found.low, "high": found.high}


def _reference(arms: Sequence[Arm], arm: Arm) -> int:
    """Place of the nominal arm that an arm is held against."""
    same = (arm.schedule, arm.condition)
    return next(i for i, other in enumerate(arms) if other.is_nominal and (other.schedule, other.condition) == same)


def _tests(
    drives: Sequence[Sequence[Document]],
    names: Sequence[str],
    arms: Sequence[Arm],
    references: Sequence[int],
    statistics: Mapping[str, int],
) -> dict[int, dict[str, Any]]:
    """Sign flips of clusters, adjusted over all arms but nominal's, by the place of the arm."""
    tested = [i for i, arm in enumerate(arms) if not arm.is_nominal]
    if not tested:
        return {}
    clusters = Clusters.of(names)
    pairs = [(_column(drives[i], "score"), _column(drives[references[i]], "score")) for i in tested]
    differences = np.stack([one - other for one, other in pairs], axis=1)
    signs = draw_signs(
        len(clusters.names), seed=statistics["seed"], num_flips=statistics["flips"], stream=CLUSTER_STREAM
    )
    found = sign_flip(differences, signs, clusters)
    adjusted = holm(found.p)
    rows = zip(tested, found.p.tolist(), adjusted.tolist(), found.is_smallest.tolist(), strict=True)
    return {i: {"p": p, "p_adjusted": holms, "p_is_bound": is_bound} for i, p, holms, is_bound in rows}


def _distinct(choices: Mapping[int, Sequence[tuple[str, ...]]]) -> list[int]:
    """Places of arms whose choices, group by group, are not those of an earlier arm."""
    first: dict[tuple[tuple[str, ...], ...], int] = {}
    for place, made in choices.items():
        first.setdefault(tuple(made), place)
    return list(first.values())


def _offline(
    driven: Sequence[Document],
    names: Sequence[str],
    arms: Sequence[Arm],
    training: Training,
    statistics: Mapping[str, int],
) -> dict[str, Any]:
    """Offline figures of the first choice of every selector, and how they go with driving scores."""
    banks = [group["bank"] for group in driven]
    utilities = executed_utilities(banks, training)
    ranked = np.flatnonzero(np.isfinite(utilities).all(axis=1)).tolist()
    if not ranked:
        return {"offline": None, "correlations": []}
    keys, nominal = training.bank.keys, training.bank.nominal_index
    exact = [i for i, arm in enumerate(arms) if arm.condition.name == CONDITIONS[0]]
    by_selector: dict[str, dict[str, Array]] = {}
    for i in (i for i in exact if arms[i].schedule == arms[exact[0]].schedule):
        chosen = [keys.index(driven[g]["drives"][i]["choices"][0]) for g in ranked]
        shares = by_score(np.eye(len(keys))[chosen])
        found = measures(shares, utilities[ranked], nominal=nominal)
        separation = [banks[g][place][_SEPARATION] for g, place in zip(ranked, chosen, strict=True)]
        contact = np.array([found_m is not None and found_m <= 0 for found_m in separation], np.float64)
        by_selector[arms[i].selector] = {"value": found.value, "regret": found.regret, "contact": contact}
    cluster_names = [names[g] for g in ranked]
    clusters, ones = Clusters.of(cluster_names), np.ones(len(ranked))
    terms = {
        f"{name} {figure}": Terms(values, ones)
        for name, found in by_selector.items()
        for figure, values in found.items()
    }
    ends = figures(
        terms, cluster_names, seed=statistics["seed"], num_resamples=statistics["resamples"],
        rates=[name for name in terms if name.endswith(" contact")],
    )  # fmt: skip
    offline = [
        {"selector": name, **{figure: _figure(ends[f"{name} {figure}"]) for figure in OFFLINE}} for name in by_selector
    ]
    rows = []
    for schedule in dict.fromkeys(arms[i].schedule for i in exact):
        at_schedule = [i for i in exact if arms[i].schedule == schedule]
        places = _distinct({i: [tuple(driven[g]["drives"][i]["choices"]) for g in ranked] for i in at_schedule})
        scores = np.stack([[driven[g]["drives"][i]["score"] for g in ranked] for i in places], axis=1)
        for figure in OFFLINE:
            sign = 1.0 if figure == "value" else -1.0
            points = sign * np.stack([by_selector[arms[i].selector][figure] for i in places], axis=1)
            found_here = correlations(
                points, scores, clusters, seed=statistics["seed"], num_resamples=statistics["resamples"]
            )
            rows.append(
                {
                    "every_ticks": schedule.every_ticks,
                    "num_decisions": schedule.num_decisions,
                    "figure": figure,
                    "num_selectors": len(places),
                    "coefficients": found_here,
                }
            )
    return {"offline": {"num_ranked": len(ranked), "selectors": offline}, "correlations": rows}
