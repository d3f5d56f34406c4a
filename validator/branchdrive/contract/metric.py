"""Metrics of predictions as declared: names, titles, units, and which of them models are compared in.

Source: spec/14-benchmark.md#metrics; declared in `schemas/v0.1/metrics.json`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from branchdrive.contract.resources import load_resource

__all__ = ["DECLARED_METRICS", "DeclaredMetric", "metric_names"]


class DeclaredMetric(NamedTuple):
    """One entry of `metrics.json`.

    Attributes:
        name: Its name; of a metric of targets, the part before the dot.
        title: For people.
        unit: ``1`` for a pure number, ``target`` for the unit of each target.
        per_target: Whether there is one for each target.
        best: Value of a perfect prediction, 0 or 1.
        paired: Whether single groups have a value.
        description: What it is.
    """

    name: str
    title: str
    unit: str
    per_target: bool
    best: int
    paired: bool
    description: str

    def names(self, targets: Iterable[str]) -> list[str]:
        """Full names: one for each target, or its own."""
        return [f"{self.name}.{target}" for target in targets] if self.per_target else [self.name]


DECLARED_METRICS: tuple[DeclaredMetric, ...] = tuple(
    DeclaredMetric(**entry) for entry in load_resource("metrics.json")["metrics"]
)
"""In the order of every list of metrics."""


def metric_names(targets: Iterable[str], *, paired_only: bool = False) -> list[str]:
    """Full names of all metrics, or of those that models are compared in."""
    targets = tuple(targets)
    return [name for metric in DECLARED_METRICS if metric.paired or not paired_only for name in metric.names(targets)]
