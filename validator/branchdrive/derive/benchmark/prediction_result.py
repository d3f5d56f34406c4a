"""Results of predictions: metrics with intervals, paired comparisons, families of tests.

Source: paper V; spec/14-benchmark.md#results.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

from branchdrive.derive.benchmark.data import BenchmarkData
from branchdrive.derive.benchmark.number import number, numbers
from branchdrive.derive.benchmark.prediction_set import PredictionSet
from branchdrive.derive.benchmark.protocol import BenchmarkProtocol, DeclaredFamily, Member
from branchdrive.derive.metric.family import adjust
from branchdrive.derive.metric.scale import Scale, target_scale
from branchdrive.derive.metric.table import Comparison, Contrast, Estimate, Interval, statistics

__all__ = [
    "comparison_record", "evaluated_members", "family_records", "interval_record", "prediction_results",
    "training_scale",
]  # fmt: skip


def training_scale(protocol: BenchmarkProtocol, data: BenchmarkData) -> Scale:
    """Scales of the targets on the partition that models are fitted on."""
    outcomes = data.part(protocol.partitions.fit).outcomes
    return target_scale(outcomes.scalars, outcomes.available)


def prediction_results(
    protocol: BenchmarkProtocol, data: BenchmarkData, predictions: PredictionSet, scale: Scale
) -> dict[str, Any]:
    """The section ``prediction``."""
    part = data.part(protocol.partitions.report)
    judged = predictions.of(protocol.partitions.report)
    families = protocol.of_kind("prediction")
    members = evaluated_members(families, judged)
    found = statistics(
        part.groups,
        part.outcomes,
        judged,
        scale,
        contrasts=[Contrast(member.left, member.right, member.metric) for member in members],
        seed=int(protocol.statistics.seed),
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
    """Adjusted p-values of every family, in the size that it declares.

    A member that was not evaluated counts with a p-value of 1. Adjusted p-values rise with those of the other
    members, so each is the largest that it could be, whatever the missing tests would say.
    """
    p_values = {comparison.name: comparison.p for comparison in comparisons}
    smallest = {comparison.name for comparison in comparisons if comparison.is_smallest}
    records = []
    for declared in families:
        given = {member.name: p_values.get(member.name, 1.0) for member in declared.members}
        adjusted = adjust([declared.family], given, smallest=smallest)[declared.name]
        members = [
            {"name": name, "p_holm": float(found.p), "is_bound": bool(found.is_bound)}
            for name, found in adjusted.items()
            if name in p_values
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


def comparison_record(found: Comparison) -> dict[str, Any]:
    """A comparison as JSON data."""
    return {
        "name": found.name,
        "difference": number(found.difference),
        "interval": interval_record(found.interval),
        "p": float(found.p),
        "is_bound": bool(found.is_smallest),
        "studentised_p": float(found.studentised_p),
        "num_groups": int(found.num_groups),
    }


def interval_record(found: Interval) -> dict[str, Any]:
    """An interval as JSON data."""
    ends = {name: number(getattr(found, name)) for name in ("low", "high", "bca_low", "bca_high")}
    return {**ends, "num_undefined": int(found.num_undefined)}


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
