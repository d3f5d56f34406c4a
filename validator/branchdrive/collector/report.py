"""What collecting a group, and a dataset, took and gave."""

from __future__ import annotations

import math
from dataclasses import dataclass

from branchdrive.contract.text import counted
from branchdrive.statistics.bca import LEAST_UNITS
from branchdrive.statistics.split import SHARES

__all__ = ["CLUSTERS_TO_CONCLUDE", "CollectionReport", "GroupReport", "routes_text"]

MIN_ROUTE_CLUSTERS = 5
"""Clusters of routes, a group each, from which a split always gives every partition one (docs/releases.md)."""

CLUSTERS_TO_CONCLUDE = math.ceil(LEAST_UNITS * 3 * 100 / (2 * SHARES["test"]))
"""Clusters of routes, a group each, from which a benchmark can conclude something.

Intervals and tests take `LEAST_UNITS` in the test partition, which has its share of the groups, and replay fidelity
under noise took a third of those in releases that were made: 6 / (2/3 x 15 %).
"""

_MAX_LISTED = 10

_SAID = {
    "unbranched_because": "has no branch",
    "refused_because": "is refused",
    "stopped_because": "stopped early",
    "note": "is collected, with a note",
}
"""What is said of a group with such a reason."""


@dataclass
class GroupReport:
    """What collecting one group took and gave.

    Attributes:
        group_id: Identity of the group.
        num_simulated: Rollouts that were executed.
        num_reused: Rollouts found finished.
        num_ticks: Ticks that were executed.
        unbranched_because: Why the nominal rollout has no branch to spend replays on; empty if it has one.
        refused_because: What rule its nominal rollout breaks, so that no replay was spent; empty if none.
        stopped_because: Why the bank is not complete; empty if it is, or no replay was spent.
        note: What is recommended of its nominal rollout; it costs the group nothing.
    """

    group_id: str
    num_simulated: int = 0
    num_reused: int = 0
    num_ticks: int = 0
    unbranched_because: str = ""
    refused_because: str = ""
    stopped_because: str = ""
    note: str = ""


@dataclass(frozen=True)
class CollectionReport:
    """What a collection has done.

    Attributes:
        groups: Reports of the groups that this run finished.
        num_found: Groups that were finished before.
        num_workers: Processes that executed groups; 1 is the collector's own.
        seconds: Wall time, writing included.
        identity: Identity of the finished dataset.
        num_branched: Branched groups of the dataset.
        num_route_clusters: Clusters of their routes.
    """

    groups: tuple[GroupReport, ...]
    num_found: int
    num_workers: int
    seconds: float
    identity: str
    num_branched: int = 0
    num_route_clusters: int = 0

    @property
    def num_ticks(self) -> int:
        """Ticks that this run executed."""
        return sum(report.num_ticks for report in self.groups)

    @property
    def ticks_per_s(self) -> float:
        """Executed ticks per second of wall time."""
        return self.num_ticks / self.seconds

    @property
    def routes_text(self) -> str:
        """How many clusters the routes make, and how many a release takes."""
        return routes_text(self.num_branched, self.num_route_clusters)

    def remarks(self, *reasons: str) -> list[str]:
        """What groups lack and why, a line each: at most ten of each reason, and how many more there are.

        Args:
            *reasons: Which reasons of `GroupReport` to tell.
        """
        lines = []
        for reason in reasons:
            concerned = [group for group in self.groups if getattr(group, reason)]
            lines += [
                f"{group.group_id} {_SAID[reason]}: {getattr(group, reason)}" for group in concerned[:_MAX_LISTED]
            ]
            if len(concerned) > _MAX_LISTED:
                lines.append(f"{len(concerned) - _MAX_LISTED:,} more: {_SAID[reason]}")
        return lines


def routes_text(num_branched: int, num_route_clusters: int) -> str:
    """How many clusters the routes of so many branched groups make, and how many a release and a benchmark take."""
    there = f"{counted(num_route_clusters, 'route cluster')} in {counted(num_branched, 'branched group')}"
    if num_route_clusters < MIN_ROUTE_CLUSTERS:
        return (
            f"{there}; a release parts whole clusters into train, val and test and takes at least "
            f"{MIN_ROUTE_CLUSTERS}: let seeds choose among more routes"
        )
    return (
        f"{there}; a release takes at least {MIN_ROUTE_CLUSTERS}, a benchmark that concludes something about "
        f"{CLUSTERS_TO_CONCLUDE}: {SHARES['test']} % of them are for test, of which replay fidelity may take a "
        "third"
    )
