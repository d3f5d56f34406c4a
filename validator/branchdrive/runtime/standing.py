"""An executor whose processes stay from call to call, and with them what functions keep between tasks."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager
from queue import SimpleQueue
from typing import TypeVar

from branchdrive.runtime.executor import BoundedProcess, Died, Executor, Failed

__all__ = ["standing"]

Task = TypeVar("Task")
Result = TypeVar("Result")


@contextmanager
def standing(jobs: int) -> Iterator[Executor]:
    """Executor over `jobs` bounded processes that stay from call to call.

    They start with the first task, keep what functions keep between tasks, and end with the block, which waits for
    tasks that run, also after an error: a caller that must not wait runs it in a process that can be killed.
    """
    with ExitStack() as stack, ThreadPoolExecutor(jobs) as threads:
        idle: SimpleQueue[BoundedProcess] = SimpleQueue()
        for _ in range(jobs):
            process = BoundedProcess()
            stack.callback(process.close)
            idle.put(process)
        starting = threading.Lock()

        def work(function: Callable[[Task], Result], task: Task) -> Result | Died | Failed:
            process = idle.get()
            try:
                with starting:
                    process.start(function)
                return process.run(function, task)
            finally:
                idle.put(process)

        def run(
            function: Callable[[Task], Result], tasks: Sequence[Task], /
        ) -> Iterator[tuple[int, Result | Died | Failed]]:
            running = {threads.submit(work, function, task): index for index, task in enumerate(tasks)}
            try:
                for future in as_completed(running):
                    yield running[future], future.result()
            finally:
                for future in running:
                    future.cancel()

        yield run
