"""Regret of every selector by scenario type, and over the types whose consequence lies inside the window.

With the regret ``r_g`` of a selector in the ranked groups ``g`` of a set ``T``, means are over groups, whatever their
type, and intervals resample the route clusters of all reported groups::

    regret over T = sum_{g in T} r_g / |T|

A type is consequential where at least `CONSEQUENTIAL_SHARE` of the drives of training that accelerate make a contact
within the window. The criterion counts contacts of recorded drives: neither a utility nor a model enters it. These
figures are printed, and stand in no document: a release keeps its results as they are.

Source: this project's choice; docs/decisions/0022-branches-in-context.md has the criterion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.cell import BY_CLUSTERS, number, with_ends
from branchdrive.benchmark.prediction.inputs import ResultInputs
from branchdrive.benchmark.prediction.metric.table import Interval
from branchdrive.benchmark.prediction.record import interval_record
from branchdrive.benchmark.protocol.selection import CLEAN_ORACLE, ORACLE
from branchdrive.benchmark.ranking.context import Contexts
from branchdrive.benchmark.ranking.ranking import SEPARATION, Ranking
from branchdrive.benchmark.ranking.record import ranked_profile
from branchdrive.contract.text import NONE
from branchdrive.statistics.bca import intervals
from branchdrive.statistics.bootstrap import counted_mean
from branchdrive.text.table import Column, Passage, Table

__all__ = ["ACCELERATE", "CONSEQUENTIAL_SHARE", "TypeRegret", "consequential_types", "regret_by_type", "type_sections"]

Mask = NDArray[np.bool_]

ACCELERATE = "accelerate"
"""Family of the candidates whose contacts make a type consequential."""

CONSEQUENTIAL_SHARE = 0.4
"""Two drives of five."""

_UNTOLD = ("random", "fixed_brake", ORACLE, CLEAN_ORACLE)
"""Selectors that tables by type go without: no reference of a claim, or without regret."""

_ALL, _CONSEQUENTIAL = "all types", "consequential types"


class TypeRegret(NamedTuple):
    """Mean regrets of the selectors over some ranked groups.

    Attributes:
        name: The scenario type, or what the set of types is called.
        num_groups: Ranked groups.
        num_clusters: Their route clusters.
        means: By selector.
        intervals: Of 95 %, by selector.
    """

    name: str
    num_groups: int
    num_clusters: int
    means: Mapping[str, float]
    intervals: Mapping[str, Interval]


def consequential_types(
    inputs: ResultInputs, types: Mapping[str, str], accelerating: Sequence[int], contact_m: float
) -> tuple[str, ...]:
    """Scenario types whose consequence lies inside the window, sorted.

    Args:
        inputs: Of the results; drives are those of the partition that models are fitted on.
        types: Scenario type by group.
        accelerating: Places of the candidates that accelerate.
        contact_m: Separation in metres up to which a drive makes a contact.
    """
    separation = inputs.fitted.targets.values[:, [*accelerating], SEPARATION]
    label = np.array([types[group] for group in inputs.fitted.groups], object)
    found = []
    for name in sorted(set(label.tolist())):
        drives = separation[label == name]
        drives = drives[np.isfinite(drives)]
        if len(drives) and float((drives <= contact_m).mean()) >= CONSEQUENTIAL_SHARE:
            found.append(name)
    return tuple(found)


def regret_by_type(
    inputs: ResultInputs, ranking: Ranking, types: Mapping[str, str], consequential: Sequence[str]
) -> list[TypeRegret]:
    """Mean regrets over each scenario type, over the consequential ones and over all, without sets that are empty.

    Args:
        inputs: Of the results.
        ranking: Of the reported groups under one profile.
        types: Scenario type by group.
        consequential: See `consequential_types`.
    """
    label = np.array([types[group] for group in inputs.reported.groups], object)
    wanted = {name: label == name for name in sorted(set(label.tolist()))}
    wanted |= {_CONSEQUENTIAL: np.isin(label, [*consequential]), _ALL: np.ones(len(label), bool)}
    ranked = ranking.population.ranked
    return [_over(inputs, ranking, name, mask & ranked) for name, mask in wanted.items() if (mask & ranked).any()]


def _over(inputs: ResultInputs, ranking: Ranking, name: str, mask: Mask) -> TypeRegret:
    """Mean regrets over the groups of a mask, all of them ranked."""
    names, resampling = list(ranking.entries), inputs.resampling
    values = np.full((len(mask), len(names)), np.nan)
    regrets = np.stack([entry.measures.regret for entry in ranking.entries.values()], axis=1)
    values[mask] = regrets[mask[ranking.population.ranked]]
    parts, there = resampling.split(counted_mean(resampling, values)), ~np.isnan(values)
    ends = intervals(*parts, there.sum(axis=0), resampling.clusters.num_there(there))
    clusters = {cluster for cluster, is_in in zip(inputs.reported.clusters, mask.tolist(), strict=True) if is_in}
    return TypeRegret(
        name,
        int(mask.sum()),
        len(clusters),
        {selector: float(parts[0][i]) for i, selector in enumerate(names)},
        {selector: Interval.of(ends, i) for i, selector in enumerate(names)},
    )


def type_sections(
    inputs: ResultInputs, contexts: Contexts | None, types: Mapping[str, str], accelerating: Sequence[int]
) -> list[Table | Passage]:
    """A table for each profile, and why another is not ranked.

    Args:
        inputs: Of the results.
        contexts: What baselines see, as for `ranking_results`.
        types: Scenario type by group.
        accelerating: Places of the candidates that accelerate.
    """
    outcomes = inputs.protocol.outcomes
    contact_m = 0.0 if outcomes is None else outcomes.contact_m
    consequential = consequential_types(inputs, types, accelerating, contact_m)
    sections: list[Table | Passage] = []
    for profile in inputs.protocol.preferences:
        try:
            ranking = ranked_profile(inputs, profile, contexts)[0]
        except ValueError as error:
            sections.append(Passage(f"Regret by scenario type, profile {profile}", [f"Not judged: {error}."]))
            continue
        sections.append(_table(profile, regret_by_type(inputs, ranking, types, consequential), ranking, consequential))
    return sections


def _table(profile: str, found: Sequence[TypeRegret], ranking: Ranking, consequential: Sequence[str]) -> Table:
    selectors = [name for name, entry in ranking.entries.items() if name not in _UNTOLD and not entry.is_tie]
    rows = [
        [
            f"{one.name} *" if one.name in consequential else one.name,
            str(one.num_groups),
            str(one.num_clusters),
            *(_cell(one, selector) for selector in selectors),
        ]
        for one in found
    ]
    columns = [Column.name("Scenario type"), Column("Groups"), Column("Clusters"), *map(Column, selectors)]
    note = (
        "Mean regret, less is better; intervals of 95 % resample route clusters and stand with sets of types alone. "
        f"A type with a star is consequential: at least {CONSEQUENTIAL_SHARE:.0%} of the accelerating drives of "
        "training make a contact within the window."
    )
    return Table(f"Regret by scenario type, profile {profile}", columns, rows, [note], has_intervals=True)


def _cell(found: TypeRegret, selector: str) -> str:
    mean = number(found.means[selector])
    if found.name not in (_CONSEQUENTIAL, _ALL) or mean == NONE:
        return mean
    record = interval_record(found.intervals[selector])
    low, high = BY_CLUSTERS
    return with_ends(mean, {"low": record[low], "high": record[high]})
