"""Draws of an audit over worker processes: what they draw from waits in a spool, where each takes it once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeVar

from branchdrive.contract.limits import spec_limits
from branchdrive.engine.spool import Spool
from branchdrive.leakage.draw import Kept
from branchdrive.runtime.executor import Executor, memory_limit, results_of

__all__ = ["SpreadDraw"]

Drawn = TypeVar("Drawn")
Made = TypeVar("Made")
Told = TypeVar("Told")


@dataclass(frozen=True)
class _DrawTask:
    spool: Spool
    name: str
    function: Callable[[Any, range], Any]
    numbers: range


def _drawn(task: _DrawTask) -> Any:
    with memory_limit(spec_limits().max_dataset_worker_bytes):
        return task.function(_subject(task.spool, task.name), task.numbers)


@dataclass(frozen=True)
class _KeepTask:
    spool: Spool
    name: str
    make: Callable[[Any], tuple[Any, Any]]
    subject: Any


def _told(task: _KeepTask) -> Any:
    with memory_limit(spec_limits().max_dataset_worker_bytes):
        made, told = task.make(task.subject)
        task.spool.put(task.name, made)
        return told


@dataclass(frozen=True)
class _Spooled:
    """A value that waits in a spool; a worker holds the one that it took last."""

    spool: Spool
    name: str

    @property
    def value(self) -> Any:
        return _value(self.spool, self.name)


@lru_cache(maxsize=1)
def _value(spool: Spool, name: str) -> Any:
    return spool.get(name)


@lru_cache(maxsize=1)
def _subject(spool: Spool, name: str) -> Any:
    return spool.get(name)


class SpreadDraw:
    """A `Workplace` over tasks of an executor.

    Args:
        spool: Where subjects wait.
        executor: Its processes have one thread of linear algebra, as the caller must have, for the same last bits.
    """

    def __init__(self, spool: Spool, executor: Executor) -> None:
        self._spool, self._executor, self._num_subjects = spool, executor, 0

    def __call__(
        self, function: Callable[[Any, range], Drawn], subject: Any, ranges: Sequence[range], /
    ) -> list[Drawn]:
        """Results of all ranges.

        Raises:
            ToolError: A task failed, or took more memory than there is.
        """
        name = self._name()
        self._spool.put(name, subject)
        tasks = [_DrawTask(self._spool, name, function, numbers) for numbers in ranges]
        return results_of(self._executor, _drawn, tasks, "a draw of the leakage audit")

    def keep(self, make: Callable[[Any], tuple[Made, Told]], subject: Any, /) -> tuple[Kept[Made], Told]:
        """A value that a worker makes and puts into the spool, and what is reported of it.

        Raises:
            ToolError: The task failed, or took more memory than there is.
        """
        name = self._name()
        tasks = [_KeepTask(self._spool, name, make, subject)]
        (told,) = results_of(self._executor, _told, tasks, "what the leakage audit sees")
        return _Spooled(self._spool, name), told

    def _name(self) -> str:
        self._num_subjects += 1
        return f"subject-{self._num_subjects}"
