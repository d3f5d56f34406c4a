"""What collecting a group, and a dataset, took and gave."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["CollectionReport", "GroupReport"]


@dataclass
class GroupReport:
    """What collecting one group took and gave.

    Attributes:
        group_id: Identity of the group.
        num_simulated: Rollouts that were executed.
        num_reused: Rollouts found finished.
        num_ticks: Ticks that were executed.
        unbranched_because: Why no replay was spent on the group; empty if it was branched.
        stopped_because: Why the bank is not complete; empty if it is, or no replay was spent.
    """

    group_id: str
    num_simulated: int = 0
    num_reused: int = 0
    num_ticks: int = 0
    unbranched_because: str = ""
    stopped_because: str = ""


@dataclass(frozen=True)
class CollectionReport:
    """What a collection has done.

    Attributes:
        groups: Reports of the groups that this run finished.
        num_found: Groups that were finished before.
        num_workers: Processes that executed groups; 1 is the collector's own.
        seconds: Wall time, writing included.
        identity: Identity of the finished dataset.
    """

    groups: tuple[GroupReport, ...]
    num_found: int
    num_workers: int
    seconds: float
    identity: str

    @property
    def num_ticks(self) -> int:
        """Ticks that this run executed."""
        return sum(report.num_ticks for report in self.groups)

    @property
    def ticks_per_s(self) -> float:
        """Executed ticks per second of wall time."""
        return self.num_ticks / self.seconds
