"""Executors: run one function over many shards, here or in bounded processes.

An executor is a plain function, so that others (a cluster) can take its place. Decoding untrusted
files belongs into processes with a memory limit; a process that dies takes one shard with it.
Source: spec/09-security.md#limits.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Protocol, TypeVar

from branchdrive.contract.limits import spec_limits

__all__ = ["Died", "Executor", "in_process", "isolated"]

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Died:
    """The process that worked on a task died, twice, without an exception."""


class Executor(Protocol):
    """Runs a picklable function over tasks; yields each task's index with its result, in any order."""

    def __call__(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], /
    ) -> Iterator[tuple[int, Result | Died]]:
        """Start the work and yield results as they come."""
        ...


def in_process(function: Callable[[Task], Result], tasks: Sequence[Task], /) -> Iterator[tuple[int, Result | Died]]:
    """Run every task in this process, in order, without a memory limit."""
    for index, task in enumerate(tasks):
        yield index, function(task)


def _limit_memory(max_bytes: int) -> None:
    try:
        import resource
    except ImportError:  # no such limit on this platform
        return
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    soft = max_bytes if hard == resource.RLIM_INFINITY else min(max_bytes, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))


def _pool(jobs: int) -> ProcessPoolExecutor:
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(jobs, context, _limit_memory, (spec_limits().max_worker_bytes,))


def _alone(function: Callable[[Task], Result], task: Task) -> Result | Died:
    """Run one task in a process of its own, so that only its own death is seen."""
    with _pool(1) as pool:
        try:
            return pool.submit(function, task).result()
        except BrokenProcessPool:
            return Died()


def isolated(jobs: int) -> Executor:
    """Executor over `jobs` processes with the spec's memory limit.

    When a process dies, the tasks that were under way run again, each in a process of its own:
    the one that kills again is reported as `Died`, the others are not affected.
    """

    def run(function: Callable[[Task], Result], tasks: Sequence[Task], /) -> Iterator[tuple[int, Result | Died]]:
        waiting = list(range(len(tasks)))[::-1]
        while waiting:
            suspects: list[int] = []
            pool = _pool(min(jobs, len(waiting)))
            running: dict[Future[Result], int] = {}
            try:
                while (waiting and not suspects) or running:
                    while waiting and not suspects and len(running) < jobs:
                        index = waiting.pop()
                        running[pool.submit(function, tasks[index])] = index
                    done, _ = wait(running, return_when=FIRST_COMPLETED)
                    for future in done:
                        index = running.pop(future)
                        if isinstance(future.exception(), BrokenProcessPool):
                            suspects.append(index)
                        else:
                            yield index, future.result()
            finally:
                pool.shutdown(wait=not suspects, cancel_futures=True)
            for index in suspects:
                yield index, _alone(function, tasks[index])

    return run
