"""One function over many tasks, in this process or in worker processes that end with it.

Which process works on a task changes nothing of its result. A worker ends at once when its parent dies or gives it
up, so that an interrupted run can be resumed immediately; asked to stop, it stops where its function asks. Workers
leave interrupts and requests to terminate to the parent. The parent hears them where it hands out work and where it
waits, and nowhere else: an exception in the middle of starting or ending workers would leave some behind without the
semaphores that they are about to open.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.queues import SimpleQueue
from multiprocessing.synchronize import Event
from typing import Any, ClassVar, TypeVar

from branchdrive.errors import ToolError
from branchdrive.runtime.elsewhere import run_elsewhere
from branchdrive.runtime.executor import Executor
from branchdrive.runtime.interrupt import deferred_interrupt, shielded_children
from branchdrive.runtime.process import exit_after, spawn_context
from branchdrive.runtime.progress import unwatched

__all__ = ["WorkerError", "num_workers", "run_each"]

_Result = TypeVar("_Result")
_Task = TypeVar("_Task")
_Between = Callable[..., None]

_HEARD_EVERY_S = 0.1
"""How long an interrupt waits to be heard, at most, while nothing is finished."""

_TASKS_PER_WORKER = 2
"""Tasks that are handed out at a time for every worker."""


class WorkerError(ToolError):
    """A worker process died."""


class _StoppedError(Exception):
    """A worker stopped in the middle of a task, whose result is not waited for any more."""


def num_workers(num_tasks: int, *, jobs: int) -> int:
    """Processes that work on `num_tasks` tasks if `jobs` may; 1 is this process."""
    return max(1, min(jobs, num_tasks))


def run_each(
    function: Callable[[_Task, _Between], _Result],
    tasks: Sequence[_Task],
    *,
    jobs: int,
    executor: Executor | None = None,
    start: Callable[[], None] = unwatched,
    watch: Callable[..., None] = unwatched,
) -> Generator[_Result, None, None]:
    """What a function returns for each task, begun in their order and given as they are finished.

    Closing the generator stops the workers and waits for them; who interrupts twice does not wait for their work.

    Args:
        function: Called with a task and with a function that it calls wherever it may stop, which passes its arguments
            to `watch`; an exception from that is passed on. For workers it is pickled, once for each, and keeps there
            what it has opened.
        tasks: What it is called with; pickled for workers.
        jobs: Processes; 1 works in this process.
        executor: What works instead of these, on other machines for example; see `run_elsewhere`.
        start: Called first in every worker.
        watch: Called in this process with what tasks report, where there are workers in a thread of its own, so that a
            result may be given before its last reports; an exception from it ends the work.

    Raises:
        ToolError: A worker process died.
        KeyboardInterrupt: The user interrupted, and every task stopped where it may.
    """
    if executor is not None:
        yield from run_elsewhere(executor, function, tasks, watch)
        return
    num_processes = num_workers(len(tasks), jobs=jobs)
    if num_processes > 1:
        yield from _in_workers(function, tasks, num_processes, start, watch)
        return
    with deferred_interrupt() as raise_if_noted:

        def between(*report: object) -> None:
            watch(*report)
            raise_if_noted()

        for task in tasks:
            yield function(task, between)
            raise_if_noted()


def _in_workers(
    function: Callable[[_Task, _Between], _Result],
    tasks: Sequence[_Task],
    jobs: int,
    start: Callable[[], None],
    watch: Callable[..., None],
) -> Generator[_Result, None, None]:
    with deferred_interrupt() as raise_if_noted:  # half an event or queue leaks semaphores
        context = spawn_context()
        stop = context.Event()
        reports = None if watch is unwatched else context.SimpleQueue()
        watched, lifeline = context.Pipe(duplex=False)  # its other end closes with this process, however that ends
    raise_if_noted()
    insisted = threading.Event()

    def end_workers() -> None:
        insisted.set()
        lifeline.close()

    with _passed_on(reports, watch, stop, insisted):
        with deferred_interrupt(insist=end_workers) as raise_if_noted:
            pool = ProcessPoolExecutor(jobs, context, _Worker.start, (watched, start, function, stop, reports))
            try:
                yield from _results(pool, tasks, _TASKS_PER_WORKER * jobs, raise_if_noted)
            except BrokenProcessPool as error:
                lifeline.close()  # the other workers do not hear the pool's request to terminate
                raise_if_noted()  # who insists ends the workers
                raise WorkerError(
                    "a worker process died; make room in memory or use fewer `--jobs`, and run the same command again "
                    "to go on"
                ) from error
            finally:
                stop.set()
                pool.shutdown(wait=True, cancel_futures=True)
                lifeline.close()
                watched.close()
        raise_if_noted()


def _results(
    pool: ProcessPoolExecutor, tasks: Sequence[Any], num_handed_out: int, raise_if_noted: Callable[[], None]
) -> Iterator[Any]:
    waiting = list(reversed(tasks))
    running: set[Future[Any]] = set()
    while waiting or running:
        while waiting and len(running) < num_handed_out:
            raise_if_noted()
            with shielded_children():  # a worker is started as work is handed out
                running.add(pool.submit(_Worker.run, waiting.pop()))
        finished: set[Future[Any]] = set()
        while not finished:
            finished, running = wait(running, _HEARD_EVERY_S, FIRST_COMPLETED)
            raise_if_noted()
        for future in finished:
            yield future.result()


@contextmanager
def _passed_on(
    reports: SimpleQueue[tuple[object, ...] | None] | None,
    watch: Callable[..., None],
    stop: Event,
    insisted: threading.Event,
) -> Iterator[None]:
    """Pass on what workers report; if the one who watches raises, they are asked to stop, and it is raised here.

    Reports are not waited for where a worker died or the user `insisted`, which ends workers where they are.
    """
    if reports is None:
        yield
        return
    raised: list[BaseException] = []

    def listen() -> None:
        while (report := reports.get()) is not None:
            if not raised:
                try:
                    watch(*report)
                except BaseException as error:
                    raised.append(error)
                    stop.set()

    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    is_broken = False
    try:
        yield
    except WorkerError:
        is_broken = True
        raise
    except _StoppedError:
        pass  # because the one who watches raised
    finally:
        if not (is_broken or insisted.is_set()):  # a process that died may hold the lock of the queue
            reports.put(None)
            listener.join()
            reports.close()
    if raised:
        raise raised[0]


class _Worker:
    """State of a worker process; never instantiated."""

    function: ClassVar[Callable[[Any, _Between], Any]]
    stop: ClassVar[Event]
    reports: ClassVar[SimpleQueue[tuple[object, ...] | None] | None]

    @classmethod
    def start(
        cls,
        watched: Connection,
        start: Callable[[], None],
        function: Callable[[Any, _Between], Any],
        stop: Event,
        reports: SimpleQueue[tuple[object, ...] | None] | None,
    ) -> None:
        exit_after(lambda: watched.poll(None))  # nothing is ever sent
        cls.function, cls.stop, cls.reports = staticmethod(function), stop, reports
        start()

    @classmethod
    def run(cls, task: Any) -> Any:
        cls.raise_if_stopped()
        return cls.function(task, cls.between)

    @classmethod
    def between(cls, *report: object) -> None:
        if cls.reports is not None:
            cls.reports.put(report)
        cls.raise_if_stopped()

    @classmethod
    def raise_if_stopped(cls) -> None:
        if cls.stop.is_set():
            raise _StoppedError
