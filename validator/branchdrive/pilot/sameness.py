"""Whether two runs of a collection say the same, and the first table, column and tick where they do not."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from branchdrive.contract.text import counted
from branchdrive.diff.compare import compare_datasets
from branchdrive.diff.difference import DatasetDifference
from branchdrive.formats.store import Store
from branchdrive.raw.reader import open_dataset

__all__ = ["Sameness", "compare_runs"]

_SHOWN = 3


@dataclass(frozen=True)
class Sameness:
    """Two runs compared by the decoded content of their attempts.

    Attributes:
        num_compared: Attempts of the first that were to be there.
        changed: Those whose data differ.
        lost: Those that the second lacks.
        added: Attempts that the second alone has.
        lost_groups: Groups that the second lacks altogether.
        descriptor: Members of the descriptors that differ.
        difference: All of it, for the place of the first cell.
    """

    num_compared: int
    changed: list[str]
    lost: list[str]
    added: list[str]
    lost_groups: list[str]
    descriptor: list[str]
    difference: DatasetDifference

    @property
    def is_same(self) -> bool:
        """Whether all attempts are there and say the same."""
        return not (self.changed or self.lost or self.added)

    @property
    def text(self) -> str:
        """What differs, in words."""
        if self.is_same:
            return f"{counted(self.num_compared, 'attempt')} equal, every value to the last bit"
        parts = []
        if self.changed:
            parts.append(f"{len(self.changed)} of {counted(self.num_compared, 'attempt')} differ")
        if self.lost_groups:
            parts.append(f"{counted(len(self.lost_groups), 'group')} missing ({_listed(self.lost_groups)})")
        elif self.lost:
            parts.append(f"{counted(len(self.lost), 'attempt')} missing ({_listed(self.lost)})")
        if self.added:
            parts.append(f"{counted(len(self.added), 'attempt')} that were not there before ({_listed(self.added)})")
        return ", ".join(parts) + (f"; {self.place}" if self.place else "")

    @property
    def place(self) -> str:
        """The first cell that differs, in words; empty where no cell that both have does."""
        cell = self.difference.first_cell
        if cell is None:
            rows = [name for name, table in self.difference.tables.items() if table.only_first or table.only_second]
            return f"rows of {', '.join(rows)} are in one run alone" if rows else ""
        table, column, found = cell
        moment = f" at tick {found.location['tick']}" if "tick" in found.location else ""
        actor = f", actor {found.location['actor_id']}" if "actor_id" in found.location else ""
        return (
            f"first in {table}.{column}{moment}{actor} of {found.location['rollout_id']}: {found.ours}, "
            f"then {found.theirs}"
        )


def compare_runs(first: Store, second: Store, group_ids: Collection[str] | None = None) -> Sameness:
    """Compare two runs.

    Args:
        first: Dataset of the first.
        second: Dataset of the second.
        group_ids: Groups that the second was to collect; all of the first by default.

    Raises:
        DatasetError: One is no finished dataset, or cannot be read.
    """
    found = compare_datasets(first, second)
    rollouts = open_dataset(first).rollouts().select(["rollout_id", "group_id"]).to_pydict()
    group_of = dict(zip(rollouts["rollout_id"], rollouts["group_id"], strict=True))
    wanted = set(group_of.values()) if group_ids is None else set(group_ids)
    lost = [attempt for attempt in found.only_first if group_of[attempt] in wanted]
    there = set(open_dataset(second).groups)
    return Sameness(
        num_compared=sum(group_id in wanted for group_id in group_of.values()),
        changed=found.changed,
        lost=lost,
        added=found.only_second,
        lost_groups=sorted({group_of[attempt] for attempt in lost} - there),
        descriptor=found.descriptor,
        difference=found,
    )


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more
