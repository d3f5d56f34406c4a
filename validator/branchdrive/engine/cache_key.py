"""Keys of a cache: digests of all that a result depends on, and of nothing else.

That is the bytes of files, descriptor, rules, options and limits, what the rest of the dataset repeats, the code of
this package with its schemas, and the libraries. So an entry never goes stale; it is only never asked for again.

Source: spec/07-rules.md#report.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

from pydantic import BaseModel

from branchdrive.engine.derived_rules import LayersTask
from branchdrive.engine.shard import ShardTask, spooled_name
from branchdrive.engine.spool import Spool

__all__ = ["Keys", "key_of", "may_keep", "shard_key"]


def may_keep(task: Any) -> bool:
    """Whether a task is of a kind whose results are kept: parts of a post mortem are not."""
    is_shard = isinstance(task, ShardTask) and task.descriptor is not None and task.is_hashed and bool(task.selected)
    return is_shard or isinstance(task, LayersTask)


class Keys:
    """Keys of tasks, as far as they do not depend on files.

    Args:
        installation: Digest of code and libraries.
    """

    def __init__(self, installation: str) -> None:
        self._installation = installation
        self._of_shards: dict[tuple[Spool | None, str], str | None] = {}
        self._known: dict[int, tuple[Any, str]] = {}

    def note(self, task: ShardTask, key: str | None) -> None:
        """Learn the key of a shard; ``None`` where its result may not be kept."""
        self._of_shards[task.spool, spooled_name(task.folder)] = key

    def of(self, task: Any) -> str | None:
        """Key of a task, as far as it is known here; ``None`` where its result is not kept."""
        if not may_keep(task):
            return None
        if isinstance(task, ShardTask):
            about = self._plain(task, leave_out=("dataset", "files", "spool"))
            return key_of({"about": about, "rows": task.spool is not None, "by": self._installation})
        raw = [self._of_shards.get((task.spool, shard)) for shard in task.raw.shards]
        if None in raw or not {*task.names} <= task.digests.keys():
            return None
        return key_of({"about": self._plain(task, leave_out=("spool",)), "rows": raw, "by": self._installation})

    def _plain(self, value: Any, leave_out: Sequence[str] = ()) -> Any:
        """A part of a task as JSON: equal for equal values, and different for others."""
        if isinstance(value, BaseModel):  # one for all tasks
            if id(value) not in self._known:
                self._known[id(value)] = value, key_of(value.model_dump(mode="json"))
            return self._known[id(value)][1]
        if is_dataclass(value):
            return {
                one.name: self._plain(getattr(value, one.name)) for one in fields(value) if one.name not in leave_out
            }
        if isinstance(value, Mapping):
            return [[key, self._plain(value[key])] for key in sorted(value)]
        if isinstance(value, frozenset):
            return sorted(value)
        return value


def shard_key(about: str, digests: Mapping[str, str]) -> str:
    """Key of a shard.

    Args:
        about: Its key as far as it does not depend on files.
        digests: SHA-256 of each of its files, by path.
    """
    return key_of([about, sorted(digests.items())])


def key_of(about: Any) -> str:
    """Key of what JSON data describes."""
    return hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()
