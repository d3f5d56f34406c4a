"""What a population is too small for: said before models are trained, and where results are read.

Source: spec/14-benchmark.md#intervals, spec/14-benchmark.md#guard.
"""

from __future__ import annotations

from collections.abc import Mapping

from branchdrive.benchmark.protocol.protocol import Guard, Partitions
from branchdrive.contract.text import counted
from branchdrive.statistics.bca import LEAST_UNITS

__all__ = ["Counts", "inconclusive_sentence", "shortage_sentences", "sizes_sentence", "unguarded_sentence"]

Counts = Mapping[str, int]
"""Groups, or their route clusters, by partition; a partition that is not there has none."""

_USE = Partitions()
_VERBS = {_USE.fit: "fitted", _USE.select: "chosen", _USE.report: "judged"}
"""What happens to models on each partition that a benchmark cannot do without."""


def sizes_sentence(groups: Counts, clusters: Counts) -> str:
    """Groups and route clusters of every partition that a benchmark uses."""
    names = (_USE.fit, _USE.select, _USE.calibrate, _USE.report)
    return f"The release has {', '.join(f'{_size(groups, clusters, name)} in `{name}`' for name in names)}."


def shortage_sentences(groups: Counts, clusters: Counts, guard: Guard | None = None) -> list[str]:
    """What a benchmark cannot do or conclude with these partitions; none where there is enough.

    Args:
        groups: Groups by partition.
        clusters: Route clusters by partition.
        guard: What is guarded; ``None`` where nothing is.
    """
    found = [
        f"No group is in `{name}`, on which models are {verb}." for name, verb in _VERBS.items() if not groups.get(name)
    ]
    further = (
        inconclusive_sentence(groups, clusters) if groups.get(_USE.report) else None,
        unguarded_sentence(groups, clusters, guard) if guard is not None else None,
    )
    return [*found, *filter(None, further)]


def inconclusive_sentence(groups: Counts, clusters: Counts) -> str | None:
    """That the reported partition has too few route clusters for any interval or test; ``None`` where it has enough.

    Args:
        groups: Groups by partition.
        clusters: Route clusters by partition.
    """
    if clusters.get(_USE.report, 0) >= LEAST_UNITS:
        return None
    return (
        f"Nothing can be concluded: `{_USE.report}` has {_size(groups, clusters, _USE.report)}, and intervals and "
        f"tests of 95 % take {LEAST_UNITS} or more."
    )


def unguarded_sentence(groups: Counts, clusters: Counts, guard: Guard) -> str | None:
    """That the guard has too few groups or route clusters to be calibrated on; ``None`` where it has enough.

    Args:
        groups: Groups by partition.
        clusters: Route clusters by partition.
        guard: What the protocol asks for.
    """
    name = _USE.calibrate
    if groups.get(name, 0) >= guard.min_groups and clusters.get(name, 0) >= guard.min_clusters:
        return None
    return (
        f"The selection-path guard will stay at nominal: `{name}` has {_size(groups, clusters, name)}, and it takes "
        f"{guard.min_groups:,} groups in {guard.min_clusters:,} route clusters or more, which `branchdrive build "
        "--calibration` sets apart."
    )


def _size(groups: Counts, clusters: Counts, name: str) -> str:
    return f"{counted(groups.get(name, 0), 'group')} in {counted(clusters.get(name, 0), 'route cluster')}"
