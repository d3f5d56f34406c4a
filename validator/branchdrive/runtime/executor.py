"""Executors: run one function over many shards, here or in bounded processes.

An executor is a plain function, so that others (a cluster) can take its place. Decoding untrusted
files belongs into processes with a memory limit; a process that dies takes one shard with it.
Source: spec/09-security.md#limits.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from multiprocessing.context import SpawnContext
from typing import Any, Protocol, TypeVar

from branchdrive.contract.limits import spec_limits
from branchdrive.contract.text import failure_text
from branchdrive.errors import PlatformError, ToolError
from branchdrive.runtime.environment import import_fault, leave_out_pandas
from branchdrive.runtime.process import ArrayContexts, array_context, exit_after

__all__ = [
    "BoundedProcess", "Died", "Executor", "Failed", "in_process", "isolated", "jobs_of", "load_soon", "memory_limit",
    "results_of",
]  # fmt: skip

_LOADED = (__name__, "pyarrow.compute", "pyarrow.parquet")
"""What workers need whatever they do with a dataset."""

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Died:
    """The process that worked on a task died, twice, without an exception, or ran out of memory."""


@dataclass(frozen=True)
class Failed:
    """The tool failed on a task, for no reason in the data: an exception, or no process to be had."""

    message: str

    @property
    def reason(self) -> str:
        """Its last line, which names the exception."""
        return self.message.rsplit("\n", 1)[-1].strip()


class Executor(Protocol):
    """Runs a picklable function over tasks; yields each task's index with its result, in any order.

    A `PlatformError` of a task ends the run: what the machine lacks concerns every task.
    """

    def __call__(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], /
    ) -> Iterator[tuple[int, Result | Died | Failed]]:
        """Start the work and yield results as they come."""
        ...


def _attempt(function: Callable[[Task], Result], task: Task) -> Result | Died | Failed:
    """Result of a task, or what its exception says.

    Raises:
        PlatformError: The machine lacks something; that is the fault of no task.
    """
    try:
        return function(task)
    except MemoryError:
        return Died()
    except PlatformError:
        raise
    except ImportError as error:
        raise import_fault(error, "this command") from error
    except Exception:  # it must not hide the results of the other tasks
        return Failed(failure_text(function.__name__))


def results_of(
    executor: Executor, function: Callable[[Task], Result], tasks: Sequence[Task], what: str
) -> list[Result]:
    """Results of tasks all of which are needed, in their order.

    Args:
        executor: How they are run.
        function: What is done with each.
        tasks: The tasks.
        what: What cannot be done without one of them, as errors name it.

    Raises:
        ToolError: A task failed, or took more memory than there is.
    """
    results: dict[int, Result] = {}
    for index, outcome in executor(function, tasks):
        if isinstance(outcome, Failed):
            raise ToolError(f"{what} failed ({outcome.reason})")
        if isinstance(outcome, Died):
            raise ToolError(
                f"{what} took more memory than there is; stop other programs or use fewer `--jobs`, and run the same "
                "command again"
            )
        results[index] = outcome
    return [results[index] for index in range(len(tasks))]


def in_process(
    function: Callable[[Task], Result], tasks: Sequence[Task], /
) -> Iterator[tuple[int, Result | Died | Failed]]:
    """Run every task in this process, in order, without a memory limit."""
    for index, task in enumerate(tasks):
        yield index, _attempt(function, task)


def _prepare_process(max_bytes: int, folder: str | None = None) -> None:
    """Let an interrupt end the process at once and in silence, let it end with its parent, and bound its memory.

    Args:
        max_bytes: Private memory that it may take.
        folder: The current folder of the one who asked, if that is another than the parent's.
    """
    leave_out_pandas()
    if folder is not None:
        os.chdir(folder)
    if (parent := multiprocessing.parent_process()) is not None:
        exit_after(parent.join)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    try:
        import resource
    except ImportError:  # no such limit on this platform
        return
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    soft = max_bytes if hard == resource.RLIM_INFINITY else min(max_bytes, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))


@contextmanager
def memory_limit(max_bytes: int) -> Iterator[None]:
    """Bound the private memory of a worker process by another limit, for a task whose need is another.

    A process that was not started for tasks has no limit, and keeps what it has.
    """
    try:
        import resource
    except ImportError:  # no such limit on this platform
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    if multiprocessing.parent_process() is None or soft == resource.RLIM_INFINITY:
        yield
        return
    wanted = max_bytes if hard == resource.RLIM_INFINITY else min(max_bytes, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (wanted, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


@contextmanager
def _quiet_start() -> Iterator[None]:
    """Hold interrupts back until a process is started: one that is cut off while it starts tells so at length."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    noted: list[int] = []
    handler = signal.getsignal(signal.SIGINT)
    if callable(handler):  # other threads may take the signal, whatever this one blocks
        signal.signal(signal.SIGINT, lambda number, _: noted.append(number))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # the new process inherits it
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if callable(handler):
            signal.signal(signal.SIGINT, handler)
        if noted:
            signal.raise_signal(signal.SIGINT)


def _loaded(module: str) -> tuple[str, ...]:
    """What workers that run a function of `module` need; modules that are not ours are left to them."""
    is_ours = module.partition(".")[0] == __name__.partition(".")[0]
    return (*_LOADED, module) if is_ours else _LOADED


def _pool(jobs: int, context: SpawnContext, folder: str | None = None) -> ProcessPoolExecutor:
    limits = (spec_limits().max_worker_bytes,) if folder is None else (spec_limits().max_worker_bytes, folder)
    return ProcessPoolExecutor(jobs, context, _prepare_process, limits)


def _import(module: str) -> None:
    """Load the module of a function, whose tasks would die where it cannot be loaded."""
    try:
        import_module(module)
    except ImportError as error:
        raise import_fault(error, "a worker process") from error


def _alone(
    function: Callable[[Task], Result], task: Task, context: SpawnContext, folder: str | None = None
) -> Result | Died | Failed:
    """Run one task in a process of its own, so that only its own death is seen."""
    with _pool(1, context, folder) as pool:
        try:
            with _quiet_start():
                first = pool.submit(_import, function.__module__)
            first.result()
        except BrokenProcessPool:
            return Failed(
                "worker processes die before they take up work; a script that validates with worker processes "
                "needs the guard `if __name__ == '__main__':`"
            )
        try:
            result = pool.submit(_attempt, function, task).result()
        except BrokenProcessPool:
            result = Died()
    if isinstance(result, Died) and (allowed := _allowed_bytes()) < spec_limits().max_worker_bytes:
        raise PlatformError(
            f"a worker process died, and processes may take no more than {allowed / 2**30:.1f} GiB of memory here, "
            f"where a dataset may need {spec_limits().max_worker_bytes / 2**30:.1f} GiB; raise `ulimit -v` and "
            "`ulimit -d`"
        )
    return result


def _allowed_bytes() -> float:
    """Memory that the system lets a process of this one take."""
    try:
        import resource
    except ImportError:  # no such limit on this platform
        return math.inf
    limits = [limit for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA) for limit in resource.getrlimit(kind)]
    return min((float(limit) for limit in limits if limit != resource.RLIM_INFINITY), default=math.inf)


def _in_pools(
    function: Callable[[Task], Result], tasks: Sequence[Task], jobs: int, context: SpawnContext
) -> Iterator[tuple[int, Result | Died | Failed]]:
    waiting = list(range(len(tasks)))[::-1]
    while waiting:
        suspects: list[int] = []
        pool = _pool(min(jobs, len(waiting)), context)
        is_broken = False
        running: dict[Future[Result | Died | Failed], int] = {}
        try:
            while (waiting and not is_broken) or running:
                while waiting and not is_broken and len(running) < jobs:
                    try:
                        with _quiet_start():
                            future = pool.submit(_attempt, function, tasks[waiting[-1]])
                    except BrokenProcessPool:  # another task's process died a moment ago
                        is_broken = True
                    else:
                        running[future] = waiting.pop()
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    index = running.pop(future)
                    if isinstance(future.exception(), BrokenProcessPool):
                        is_broken = True
                        suspects.append(index)
                    elif isinstance(result := future.result(), Died):
                        suspects.append(index)
                    else:
                        yield index, result
        finally:
            pool.shutdown(wait=not is_broken, cancel_futures=True)
        for index in suspects:
            yield index, _alone(function, tasks[index], context)


@dataclass(frozen=True)
class _Isolated:
    """An executor over processes of its own, which end with each call; what has imported their modules stays."""

    jobs: int
    contexts: ArrayContexts = field(default_factory=ArrayContexts, compare=False, repr=False)

    def __call__(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], /
    ) -> Iterator[tuple[int, Result | Died | Failed]]:
        if tasks:
            yield from _in_pools(function, tasks, self.jobs, self.contexts.get(*_loaded(function.__module__)))


def isolated(jobs: int) -> Executor:
    """Executor over `jobs` processes with the spec's memory limit.

    When a process dies, the tasks that were under way run again, each in a process of its own:
    the one that kills again is reported as `Died`, the others are not affected.
    """
    return _Isolated(jobs)


def load_soon(executor: Executor, module: str) -> Executor:
    """The executor; if it is `isolated`, what it needs for functions of a module begins to be loaded."""
    if isinstance(executor, _Isolated):
        executor.contexts.start(*_loaded(module))
    return executor


def jobs_of(executor: Executor) -> int:
    """Processes that `isolated` was given; 1 of any other executor, which may not reach this machine's disk."""
    return executor.jobs if isinstance(executor, _Isolated) else 1


class BoundedProcess:
    """One process with the spec's memory limit, for workers of an engine that has processes of its own.

    What an engine starts has no bound, may have the current folder of others on its path, and computes in many threads.
    So its worker keeps one of these, and hands it one task after the other.

    Args:
        folder: The current folder that relative paths of tasks are meant in.
    """

    def __init__(self, folder: str | None = None) -> None:
        self._folder = folder
        self._stack = ExitStack()
        self._context: SpawnContext | None = None
        self._pool: ProcessPoolExecutor | None = None

    def run(self, function: Callable[[Task], Result], task: Task) -> Result | Died | Failed:
        """Result of a task; one whose process dies runs again, in another one.

        Raises:
            PlatformError: The machine lacks something.
        """
        context = self.start(function)
        if self._pool is None:
            self._pool = _pool(1, context, self._folder)
        try:
            result = self._pool.submit(_attempt, function, task).result()
        except BrokenProcessPool:
            result = Died()
        if isinstance(result, Died):
            self._end()
            result = _alone(function, task, context, self._folder)
        return result

    def start(self, function: Callable[[Any], Any]) -> SpawnContext:
        """Start what starts the process, with the module of a function loaded; once.

        Raises:
            PlatformError: The machine lacks something.
        """
        if self._context is None:
            self._context = self._stack.enter_context(array_context(*_loaded(function.__module__)))
        return self._context

    def close(self) -> None:
        """End the process."""
        self._end()
        self._stack.close()
        self._context = None

    def _end(self) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
        self._pool = None
