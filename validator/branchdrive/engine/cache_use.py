"""What a run took of a cache, as its report says it.

Source: spec/07-rules.md#report.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from branchdrive.contract.text import counted

__all__ = ["CacheUse"]


@dataclass
class CacheUse:
    """What a run took of a cache.

    Attributes:
        shards: Folders of the shards that an earlier run judged.
        by_version: Those of them whose files were not read, since the versions were those that an earlier run read.
        num_layer_tasks: Tasks on derived layers that one judged.
        versions: Versions of the validator that judged them.
        num_rechecked: How many of both were judged again.
        num_damaged: Entries that could not be read; what they held was judged again.
        num_unasked: Tasks for which the cache could not be asked, or did not take what they gave.
        fault: Why, the first time.
        differences: Entries that are not what judging again gives.
    """

    shards: set[str] = field(default_factory=set)
    by_version: set[str] = field(default_factory=set)
    num_layer_tasks: int = 0
    versions: set[str] = field(default_factory=set)
    num_rechecked: int = 0
    num_damaged: int = 0
    num_unasked: int = 0
    fault: str = ""
    differences: list[str] = field(default_factory=list)

    def conditions(self, num_shards: int) -> Iterator[str]:
        """What of it the verdict depends on, one line each.

        Args:
            num_shards: Shards of the dataset.
        """
        if self.shards or self.num_layer_tasks:
            by = f"judged by an earlier run of version {', '.join(sorted(self.versions))}"
            again = f"; {self.num_rechecked:,} of these judged again" if self.num_rechecked else ""
            layers = f" and {counted(self.num_layer_tasks, 'task')} on derived layers" if self.num_layer_tasks else ""
            yield f"{len(self.shards)} of {counted(num_shards, 'shard')}{layers} {by}{again}"
        if self.by_version:
            yield (
                f"the versions that the store lists stood for the bytes of {len(self.by_version)} of "
                f"{counted(num_shards, 'shard')}, which were not read"
            )
        if self.num_damaged:
            yield f"{counted(self.num_damaged, 'damaged file')} in the cache, whose tasks were judged again"
        if self.num_unasked:
            yield f"the cache did not serve {counted(self.num_unasked, 'task')}, judged without it: {self.fault}"

    def to_json(self) -> dict[str, Any]:
        """The use as the report schema has it."""
        return {
            "shards": len(self.shards),
            "by_version": len(self.by_version),
            "layer_tasks": self.num_layer_tasks,
            "versions": sorted(self.versions),
            "rechecked": self.num_rechecked,
            "damaged": self.num_damaged,
            "unasked": self.num_unasked,
        }
