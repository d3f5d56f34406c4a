"""Worker processes that end with this one.

A worker ends at once when its parent dies or gives it up, so that an interrupted run can be resumed immediately;
asked to stop, it stops where it chooses. Workers leave interrupts and requests to terminate to the parent. The parent
hears them where it hands out work and where it waits, and nowhere else: an exception in the middle of starting or
ending workers would leave some behind without the semaphores that they are about to open.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext
from multiprocessing.synchronize import Event
from typing import ParamSpec, TypeVar

from branchdrive.errors import ToolError
from branchdrive.interrupt import deferred_interrupt, shielded_children
from branchdrive.process import exit_after

__all__ = ["WorkerError", "Workers", "started_workers"]

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")
_Task = TypeVar("_Task")

_HEARD_EVERY_S = 0.1
"""How long an interrupt waits to be heard, at most, while nothing is finished."""

_TASKS_PER_WORKER = 2
"""Tasks that are handed out at a time for every worker."""


class WorkerError(ToolError):
    """A worker process died."""


class Workers:
    """Processes that work for this one; see `started_workers`."""

    def __init__(self, pool: ProcessPoolExecutor, num_workers: int, raise_if_noted: Callable[[], None]) -> None:
        self._pool, self._num_workers, self._raise_if_noted = pool, num_workers, raise_if_noted

    def results(self, function: Callable[[_Task], _Result], tasks: Sequence[_Task]) -> Iterator[_Result]:
        """What a call returns for each task, begun in their order and given as they are finished.

        Raises:
            KeyboardInterrupt: The user interrupted.
        """
        waiting = list(reversed(tasks))
        running: set[Future[_Result]] = set()
        while waiting or running:
            while waiting and len(running) < _TASKS_PER_WORKER * self._num_workers:
                running.add(self.submit(function, waiting.pop()))
            finished, running = self.wait(running)
            for future in finished:
                yield future.result()

    def submit(
        self, function: Callable[_Arguments, _Result], *args: _Arguments.args, **kwargs: _Arguments.kwargs
    ) -> Future[_Result]:
        """Hand out a call.

        Raises:
            KeyboardInterrupt: The user interrupted.
        """
        self._raise_if_noted()
        with shielded_children():  # a worker is started as work is handed out
            return self._pool.submit(function, *args, **kwargs)

    def wait(self, running: set[Future[_Result]]) -> tuple[set[Future[_Result]], set[Future[_Result]]]:
        """Wait until a call is finished; returns those that are, and the others.

        Raises:
            KeyboardInterrupt: The user interrupted.
        """
        finished: set[Future[_Result]] = set()
        while running and not finished:
            finished, running = wait(running, _HEARD_EVERY_S, FIRST_COMPLETED)
            self._raise_if_noted()
        return finished, running


@contextmanager
def started_workers(
    context: SpawnContext, num_workers: int, stop: Event, start: Callable[..., None], *arguments: object
) -> Iterator[Workers]:
    """Worker processes, which are asked to stop and waited for at the end; who insists does not wait for their work.

    Args:
        context: How processes are started.
        num_workers: Processes, at most.
        stop: Set at the end.
        start: Called first in every worker.
        *arguments: What it is called with.

    Raises:
        WorkerError: A worker process died.
        KeyboardInterrupt: The user interrupted.
    """
    watched, lifeline = context.Pipe(duplex=False)  # its other end closes with this process, however that ends
    with deferred_interrupt(insist=lifeline.close) as raise_if_noted:
        pool = ProcessPoolExecutor(num_workers, context, _start, (watched, start, arguments))
        try:
            yield Workers(pool, num_workers, raise_if_noted)
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


def _start(watched: Connection, start: Callable[..., None], arguments: tuple[object, ...]) -> None:
    exit_after(lambda: watched.poll(None))  # nothing is ever sent
    start(*arguments)
