"""Results of predictions: metrics with intervals, paired comparisons, families of tests.

Source: paper, "Experiments"; spec/14-benchmark.md#results.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from branchdrive.benchmark.prediction.inputs import ResultInputs
from branchdrive.benchmark.prediction.metric.table import Comparison, Contrast, Estimate, Interval, statistics
from branchdrive.benchmark.protocol.family import Adjusted, adjust
from branchdrive.benchmark.protocol.protocol import DeclaredFamily, Member
from branchdrive.benchmark.protocol.undeclared import undeclared_predictions
from branchdrive.statistics.rounding import number, numbers

__all__ = ["comparison_record", "evaluated_members", "family_records", "interval_record", "prediction_results"]


def prediction_results(inputs: ResultInputs) -> dict[str, Any]:
    """The section ``prediction``."""
    protocol, part, judged, scale = inputs.protocol, inputs.reported, inputs.judged, inputs.scale
    families = protocol.of_kind("prediction")
    members = [*evaluated_members(families, judged), *undeclared_predictions(protocol, judged)]
    found = statistics(
        part.groups,
        part.clusters,
        part.outcomes,
        judged,
        scale,
        contrasts=[Contrast(member.left, member.right, member.metric) for member in members],
        seed=inputs.seed,
        num_resamples=int(protocol.statistics.resamples),
        num_flips=int(protocol.statistics.flips),
    )
    return {
        "scale": {"iqr": numbers(scale.iqr.tolist()), "sd": numbers(scale.sd.tolist())},
        "estimates": [_estimate_record(estimate) for estimate in found.estimates],
        "comparisons": [comparison_record(comparison) for comparison in found.comparisons],
        "families": family_records(families, found.comparisons),
    }


def evaluated_members(families: Iterable[DeclaredFamily], names: Collection[str]) -> list[Member]:
    """Members of families whose both sides are among `names`, each once, in the declared order."""
    members = {member.name: member for family in families for member in family.members}
    return [member for member in members.values() if member.left in names and member.right in names]


def family_records(families: Iterable[DeclaredFamily], comparisons: Sequence[Comparison]) -> list[dict[str, Any]]:
    """Adjusted p-values of every family, in the size that it declares, by groups and by clusters.

    A member that was not evaluated counts with a p-value of 1. Adjusted p-values rise with those of the other
    members, so each is the largest that it could be, whatever the missing tests would say.
    """
    evaluated = {found.name for found in comparisons}
    records = []
    for declared in families:
        groups = _adjusted(declared, {found.name: (found.p, found.is_smallest) for found in comparisons})
        clusters = _adjusted(
            declared, {found.name: (found.p_clusters, found.is_smallest_clusters) for found in comparisons}
        )
        members = [
            {
                "name": name,
                "p_holm": float(groups[name].p),
                "is_bound": bool(groups[name].is_bound),
                "p_holm_clusters": float(clusters[name].p),
                "is_bound_clusters": bool(clusters[name].is_bound),
            }
            for name in groups
            if name in evaluated
        ]
        records.append(
            {
                "name": declared.name,
                "num_declared": len(declared.members),
                "num_evaluated": len(members),
                "members": members,
            }
        )
    return records


def _adjusted(declared: DeclaredFamily, found: Mapping[str, tuple[float, bool]]) -> Mapping[str, Adjusted]:
    """Adjusted p-values of a family, of p-values by test and whether each is the smallest that its flips allow."""
    given = {member.name: found[member.name][0] if member.name in found else 1.0 for member in declared.members}
    smallest = {name for name, (_, is_smallest) in found.items() if is_smallest}
    return adjust([declared.family], given, smallest=smallest)[declared.name]


def comparison_record(found: Comparison) -> dict[str, Any]:
    """A comparison as JSON data."""
    return {
        "name": found.name,
        "difference": number(found.difference),
        "interval": interval_record(found.interval),
        "p": float(found.p),
        "is_bound": bool(found.is_smallest),
        "p_clusters": float(found.p_clusters),
        "is_bound_clusters": bool(found.is_smallest_clusters),
        "studentised_p": float(found.studentised_p),
        "is_bound_studentised": bool(found.is_smallest_studentised),
        "intra_cluster_correlation": number(found.correlation),
        "num_groups": int(found.num_groups),
        "num_clusters": int(found.num_clusters),
    }


def interval_record(found: Interval) -> dict[str, Any]:
    """An interval as JSON data."""
    return {
        name: int(value) if name.endswith("num_undefined") else number(value) for name, value in found._asdict().items()
    }


def _estimate_record(found: Estimate) -> dict[str, Any]:
    return {
        "model": found.model,
        "metric": found.metric,
        "value": number(found.value),
        "seed_sd": number(found.seed_sd),
        "by_seed": numbers(found.by_seed),
        "interval": interval_record(found.interval),
        "num_groups": int(found.num_groups),
    }
