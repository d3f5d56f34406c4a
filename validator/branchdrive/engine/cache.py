"""What an earlier run found out, taken instead of being found out again: an executor around an executor.

A result is kept under a digest of all that it depends on. Workers look into the cache, so that this is as parallel as
judging; here is where it is, how far it is believed, and what a run took of it. No verdict waits for a cache.

Source: spec/07-rules.md#report.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from branchdrive.contract.text import counted
from branchdrive.engine.cache_key import Keys, may_keep
from branchdrive.engine.cached_task import CachedTask, Kept, Outcome, judge_once
from branchdrive.engine.shard import ShardTask
from branchdrive.errors import UsageError
from branchdrive.formats.private_folder import PrivateFolder
from branchdrive.formats.private_prefix import PrivatePrefix
from branchdrive.runtime.executor import Executor
from branchdrive.runtime.installation import installation_digest

__all__ = ["Cache", "CacheUse", "caching", "is_url", "open_kept"]


@dataclass(frozen=True)
class Cache:
    """Where results are kept, and how far they are believed.

    Attributes:
        path: A folder of one's own, which is made where it is missing, or the URL of a prefix in a bucket (extra
            `cloud`), where the bucket says who may write.
        recheck: Share of the results taken that are judged again.
        max_bytes: What may lie in a folder when a run is over; what was not used for longest goes first. A bucket has
            rules of its own for what is old.
        trust_versions: Whether the version of an object that a bucket lists stands for the bytes that an earlier run
            read of it, so that shards whose result is taken are not read.

    Raises:
        UsageError: The share is none.
    """

    path: Path | str
    recheck: float = 0.0
    max_bytes: int = 16 << 30
    trust_versions: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.recheck <= 1:
            raise UsageError(f"`recheck` is {self.recheck!r}, not a share from 0 to 1")


def is_url(path: Path | str) -> bool:
    """Whether a cache is in a bucket."""
    return "://" in str(path)


def open_kept(cache: Cache) -> Kept:
    """Where a cache keeps results.

    Raises:
        UsageError: It is no folder of this user alone, nor the URL of a bucket.
        PlatformError: A library is missing.
    """
    return PrivatePrefix.at(str(cache.path)) if is_url(cache.path) else PrivateFolder.at(cache.path)


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


def caching(executor: Executor, cache: Cache, kept: Kept, use: CacheUse, *, day: int) -> Executor:
    """Executor that runs by another one what is not in the cache.

    Args:
        executor: What runs tasks; where it does so on another machine, a folder may be missing there.
        cache: How far results are believed.
        kept: Where they are kept.
        use: Counts what was taken.
        day: Number of the day; on each, others are judged again.
    """
    keys, name = Keys(installation_digest()), os.urandom(16).hex()

    def run(function: Callable[[Any], Any], tasks: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
        if not any(map(may_keep, tasks)):
            yield from executor(function, tasks)
            return
        wrapped = [
            CachedTask(function, task, kept, name, cache.trust_versions, cache.recheck, day, keys.of(task))
            for task in tasks
        ]
        for index, outcome in executor(judge_once, wrapped):
            if isinstance(outcome, Outcome):
                note(tasks[index], outcome)
                yield index, outcome.result
            else:
                yield index, outcome

    def note(task: Any, outcome: Outcome) -> None:
        if isinstance(task, ShardTask):
            keys.note(task, outcome.key)
            use.shards.discard(task.folder)  # where it is judged once more, the last time counts
            use.by_version.discard(task.folder)
            use.shards |= {task.folder} if outcome.version else set()
            use.by_version |= {task.folder} if outcome.is_by_version else set()
        else:
            use.num_layer_tasks += outcome.version is not None
        use.versions |= {outcome.version} if outcome.version else set()
        use.num_rechecked += outcome.is_rechecked
        use.num_damaged += outcome.is_damaged
        use.num_unasked += outcome.fault is not None
        use.fault = use.fault or outcome.fault or ""
        use.differences += [outcome.difference] if outcome.difference else []

    return run
