"""Processes that work through cases: one that takes too long or dies costs its case alone."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

__all__ = ["Lost", "run_cases"]

_CONTEXT = multiprocessing.get_context("spawn")


@dataclass(frozen=True)
class Lost:
    """Why a case has no result: its process took too long, or, which `is_death`, died."""

    reason: str
    is_death: bool


def _work(connection: Connection, seed: int, bases: Mapping[str, Path], work: Path, max_cpu_s: float) -> None:
    """Run the cases whose numbers come, until none comes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ[name] = "1"
    from tests.fuzz.case import Fuzz

    fuzz = Fuzz(seed, bases, work, max_cpu_s=max_cpu_s)
    with suppress(EOFError, ConnectionError):  # the run is over
        while True:
            connection.send(fuzz.run(connection.recv()))


class _Worker:
    """A process with the case it is at."""

    def __init__(self, seed: int, bases: Mapping[str, Path], work: Path, max_cpu_s: float) -> None:
        self.connection, theirs = _CONTEXT.Pipe()
        self.process = _CONTEXT.Process(target=_work, args=(theirs, seed, bases, work, max_cpu_s), daemon=True)
        self.process.start()
        theirs.close()

    def start(self, index: int, limit_s: float) -> None:
        self.index, self.deadline = index, time.monotonic() + limit_s
        with suppress(BrokenPipeError):  # it died; the next look at it says so
            self.connection.send(index)

    def end(self) -> None:
        self.connection.close()
        self.process.kill()
        self.process.join()


def run_cases(
    indices: Iterable[int],
    seed: int,
    bases: Mapping[str, Path],
    work: Path,
    *,
    jobs: int,
    limit_s: float,
    max_cpu_s: float,
) -> Iterator[tuple[int, Any]]:
    """Results of cases, as they come, each with its number; `Lost` where there is none.

    Args:
        indices: Numbers of the cases.
        seed: Seed of all cases.
        bases: Roots of the valid datasets.
        work: Folder for the processes.
        jobs: Number of processes.
        limit_s: Time after which a case is given up; the first of a process gets ten times as much.
        max_cpu_s: Processor time above which a case is a failure.
    """
    waiting, workers, folders = iter(indices), dict[int, _Worker](), list[Path]()
    try:
        work.mkdir(parents=True, exist_ok=True)
        folders = [Path(tempfile.mkdtemp(dir=work)) for _ in range(jobs)]  # a run before may still be ending
        for number in range(jobs):
            if (index := next(waiting, None)) is None:
                break
            workers[number] = _Worker(seed, bases, folders[number], max_cpu_s)
            workers[number].start(index, 10 * limit_s)
        while workers:
            by_connection = {worker.connection: number for number, worker in workers.items()}
            ready = wait(list(by_connection), timeout=1.0)
            for connection, number in by_connection.items():
                worker = workers[number]
                if connection in ready:
                    try:
                        yield worker.index, worker.connection.recv()
                        is_lost = False
                    except (EOFError, ConnectionError):
                        worker.process.join()
                        yield worker.index, Lost(f"its process died with {worker.process.exitcode}", is_death=True)
                        is_lost = True
                elif time.monotonic() > worker.deadline:
                    yield worker.index, Lost(f"it took more than {limit_s:g} s", is_death=False)
                    is_lost = True
                else:
                    continue
                index = next(waiting, None)
                if is_lost or index is None:
                    worker.end()
                    del workers[number]
                if index is not None:
                    if is_lost:
                        workers[number] = _Worker(seed, bases, folders[number], max_cpu_s)
                    workers[number].start(index, (10 if is_lost else 1) * limit_s)
    finally:
        for worker in workers.values():
            worker.end()
        for folder in folders:
            shutil.rmtree(folder, ignore_errors=True)
