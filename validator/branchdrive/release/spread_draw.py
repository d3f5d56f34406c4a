"""Draws of an audit over worker processes: the subject waits in a spool, from which each worker takes it once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeVar

from branchdrive.contract.limits import spec_limits
from branchdrive.engine.spool import Spool
from branchdrive.runtime.executor import Executor, memory_limit, results_of

__all__ = ["SpreadDraw"]

Drawn = TypeVar("Drawn")


@dataclass(frozen=True)
class _DrawTask:
    spool: Spool
    name: str
    function: Callable[[Any, range], Any]
    numbers: range


def _drawn(task: _DrawTask) -> Any:
    with memory_limit(spec_limits().max_dataset_worker_bytes):
        return task.function(_subject(task.spool, task.name), task.numbers)


@lru_cache(maxsize=1)
def _subject(spool: Spool, name: str) -> Any:
    return spool.get(name)


class SpreadDraw:
    """A `Draw` over tasks of an executor.

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
        name = f"subject-{self._num_subjects}"
        self._num_subjects += 1
        self._spool.put(name, subject)
        tasks = [_DrawTask(self._spool, name, function, numbers) for numbers in ranges]
        return results_of(self._executor, _drawn, tasks, "a draw of the leakage audit")
