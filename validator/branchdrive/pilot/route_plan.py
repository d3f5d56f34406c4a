"""Route clusters of a pilot, and whether a split and a calibration partition will be feasible in a collection.

With ``f_1`` clusters of one group and ``f_2`` of two among ``n`` groups, the clusters of ``N`` groups are expected as::

    f_0  = (n - 1) / n * f_1^2 / (2 f_2)            clusters not seen yet
           (n - 1) / n * f_1 (f_1 - 1) / 2          where no cluster has two groups
    S(N) = S(n) + f_0 (1 - (1 - f_1 / (n f_0 + f_1))^(N - n))

Source: Chao 1984; Chao et al. 2014, equation 9. A lower bound where many routes are rare.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from branchdrive.benchmark.guard.calibration import MIN_CLUSTERS, MIN_GROUPS
from branchdrive.contract.text import NONE, counted, percent
from branchdrive.driving.route_cluster import CLUSTER_RMS_M
from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.section import Concern, Section
from branchdrive.quality.partition import PARTITIONS, partition_sizes
from branchdrive.statistics.split import SHARES, Calibration, assign_split
from branchdrive.text.table import Column, Table

__all__ = ["expected_clusters", "route_plan"]

_TITLE = "Routes, split and calibration"

_SEED = 1
"""Of the draws of partitions; another one moves single clusters."""

_MIN_GROUPS = 8
"""Groups below which the share of a cluster says nothing."""

_SMALLEST_SHARE = min(SHARES.values()) / 100


def route_plan(pilot: Pilot) -> Section:
    """Clusters of routes now and expected, and the partitions that they allow."""
    if not pilot.parts:
        return Section("routes", _TITLE, not_examined=[pilot.unread])
    collected = pilot.collected
    clusters, num_unusable = collected.cluster_of_groups, int((~collected.has_route).sum())
    if not clusters:
        return Section("routes", _TITLE, not_examined=["no group has a usable route (BD-VAL-001, BD-VAL-005)"])
    sizes = sorted(Counter(clusters.values()).values(), reverse=True)
    num_groups = _num_complete(pilot)
    expected = round(expected_clusters(sizes, max(num_groups, len(clusters))))
    scenario_types = set(collected.scenario_type[collected.has_route].tolist())
    is_open = sizes.count(1) > len(sizes) / 2
    facts = [
        f"{counted(len(clusters), 'group')} lie in {counted(len(sizes), 'route cluster')} (routes of one town less "
        f"than {CLUSTER_RMS_M:g} m apart), of {counted(len(collected.attempts_by_town), 'town')} and "
        f"{counted(len(scenario_types), 'scenario type')}; the largest holds {sizes[0]}.",
        f"{counted(num_groups, 'group')} that qualify would lie in about {counted(expected, 'route cluster')}"
        + (", a guess by Chao's estimate that may be far off: most routes were seen once only." if is_open
           else ", if routes are drawn as they were in the pilot."),
    ]  # fmt: skip
    concerns, rows, not_examined = [], [], []
    figures: dict[str, Any] = {"clusters": len(sizes), "sizes": sizes, "expected": expected, "groups": num_groups}
    for name, num_clusters in (("routes of the pilot alone", len(sizes)), ("expected routes", expected)):
        labels = _grown(sizes, num_groups, num_clusters)
        for least in (None, Calibration(MIN_GROUPS, MIN_CLUSTERS)):
            drawn, why = _drawn(labels, least)
            rows.append([name, "yes" if least else "no", *_cells(drawn), "yes" if not why else f"no: {why}"])
            figures[f"{name}, {'with' if least else 'without'} calibration"] = drawn if not why else None
            if why and name == "expected routes" and is_open:
                not_examined.append(
                    f"whether partitions {'with' if least else 'without'} calibration are feasible: most routes of the "
                    "pilot were seen once only, so that nothing says how many there are"
                )
            elif why and name == "expected routes":
                concerns.append(_infeasible(why, expected, num_groups, with_calibration=least is not None))
    share = sizes[0] / len(clusters)
    if share > _SMALLEST_SHARE and len(clusters) >= _MIN_GROUPS and len(sizes) > 1:
        concerns.append(
            Concern(
                f"The largest cluster holds {percent(share, 0)} of the groups. A cluster is never divided, so that a "
                f"partition of {min(SHARES.values())} % may miss its share by as much.",
                "Spread seeds evenly over routes.",
                is_problem=False,
            )
        )
    if num_unusable:
        facts.append(f"{counted(num_unusable, 'group')} with an unusable route left out.")
    heads = [
        Column.name("Clusters"), Column("Calibration asked for", is_text=True),
        *(Column(name.capitalize()) for name in PARTITIONS), Column("Feasible", is_text=True),
    ]  # fmt: skip
    note = (
        f"Groups / clusters of each partition of {num_groups:,} groups; calibration asks for {MIN_GROUPS} groups and"
        f" {MIN_CLUSTERS} clusters, which the guard of the benchmark takes."
    )
    return Section("routes", _TITLE, facts, concerns, [Table("Partitions", heads, rows, [note])], not_examined, figures)


def expected_clusters(sizes: Sequence[int], num_groups: int) -> float:
    """Clusters among `num_groups` groups that are drawn as those of `sizes` were; at least as many groups."""
    n, f_1, f_2 = sum(sizes), sum(size == 1 for size in sizes), sum(size == 2 for size in sizes)
    f_0 = (n - 1) / n * (f_1**2 / (2 * f_2) if f_2 else f_1 * (f_1 - 1) / 2)
    if f_0 == 0:
        return float(len(sizes))
    return len(sizes) + f_0 * (1 - (1 - f_1 / (n * f_0 + f_1)) ** (num_groups - n))


def _num_complete(pilot: Pilot) -> int:
    """Integrity-complete groups of the collection, as the pilot has them; all where it has none."""
    funnel = pilot.report.funnel
    complete = funnel.groups["integrity"] if funnel is not None else 0
    share = complete / pilot.num_groups if complete else 1.0
    return max(1, round(pilot.num_wanted * share))


def _grown(sizes: Sequence[int], num_groups: int, num_clusters: int) -> list[int]:
    """Cluster of every group of a collection: known clusters in proportion, new ones share what is left evenly."""
    num_new = max(0, num_clusters - len(sizes))
    seen = 1 - sizes.count(1) / sum(sizes) if num_new else 1.0  # Good's coverage
    weights = [size * max(seen, 1e-9) / sum(sizes) for size in sizes] + [(1 - seen) / max(1, num_new)] * num_new
    if seen == 0:
        weights = [1.0] * num_clusters
    ends = np.round(np.cumsum(weights) / sum(weights) * num_groups).astype(int)
    return np.searchsorted(ends, np.arange(num_groups), side="right").tolist()  # type: ignore[no-any-return]


def _drawn(labels: Sequence[int], least: Calibration | None) -> tuple[dict[str, dict[str, int]], str]:
    """Groups and clusters of every partition, and why the split is not feasible."""
    group_ids = [f"g{i:06d}" for i in range(len(labels))]
    try:
        assignment = assign_split(group_ids, labels, [""] * len(labels), seed=_SEED, calibration=least)
    except ValueError:
        return {}, f"{counted(len(set(labels)), 'cluster')}, none of which is left beside the calibration"
    drawn = partition_sizes(assignment, dict(zip(group_ids, labels, strict=True)))
    empty = [name for name in SHARES if name not in drawn]
    return drawn, f"nothing left for {', '.join(empty)}" if empty else ""


def _cells(drawn: dict[str, dict[str, int]]) -> list[str]:
    return [
        f"{drawn[name]['groups']:,} / {drawn[name]['clusters']:,}" if name in drawn else NONE for name in PARTITIONS
    ]


def _infeasible(why: str, expected: int, num_groups: int, *, with_calibration: bool) -> Concern:
    if with_calibration:
        return Concern(
            f"A calibration partition of {MIN_GROUPS} groups and {MIN_CLUSTERS} clusters is not feasible with about "
            f"{counted(expected, 'route cluster')} in {num_groups:,} groups: {why}.",
            f"Drive at least {MIN_CLUSTERS + len(SHARES)} routes that lie apart, better {2 * MIN_CLUSTERS} and more; "
            "or build without --calibration and without the guard.",
            is_problem=False,
        )
    return Concern(
        f"No split into {', '.join(SHARES)} is feasible with about {counted(expected, 'route cluster')}: {why}.",
        f"Drive at least {len(SHARES)} routes that lie apart; a cluster is never divided between partitions.",
    )
