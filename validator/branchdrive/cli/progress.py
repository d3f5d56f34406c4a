"""Progress of long work: on a terminal a bar with counts, rate and the time that is left, elsewhere a line a minute."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from time import monotonic
from typing import Protocol, TextIO

__all__ = ["Update", "part_lines", "progress_bar"]


class Update(Protocol):
    """Shows how far the work is; `note` stands beside the count."""

    def __call__(self, done: int, total: int, note: str = "") -> None:
        """Show `done` of `total`."""


_LINE_S = 60.0
"""Seconds between lines where there is no bar."""

_TOLD_FROM = 3
"""Steps after which the time left is shown: the first one also starts what the others find running."""


@contextmanager
def progress_bar(stderr: TextIO, title: str, *, clock: Callable[[], float] = monotonic) -> Iterator[Update]:
    """A progress bar on `stderr` if that is a terminal, gone when the work is over; elsewhere a line a minute.

    Args:
        stderr: Where it is shown.
        title: What is done.
        clock: Seconds from any moment on.
    """
    if not stderr.isatty():
        yield _minute_lines(stderr, title, clock)
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        Task,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    class _Rate(ProgressColumn):
        """How many are done in a second, or in a minute where that is less than one."""

        def render(self, task: Task) -> str:
            return "" if not task.speed else _rate(task.speed)

    columns = (
        TextColumn(title),
        BarColumn(),
        MofNCompleteColumn(),
        _Rate(),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(file=stderr), transient=True) as bar:
        task = bar.add_task(title, total=None, note="")
        yield lambda done, total, note="": bar.update(task, completed=done, total=total, note=note)


def _minute_lines(stderr: TextIO, title: str, clock: Callable[[], float]) -> Update:
    """Tells how far the work is, once a minute and never in the first; a line that cannot be written stops no work."""
    start = last = clock()
    work = (0, 0)

    def tell(done: int, total: int, note: str = "") -> None:
        nonlocal start, last, work
        now = clock()
        if done < work[0] or total != work[1]:  # other work begins
            start = now if work[1] else start
        work = done, total
        if now - last < _LINE_S:
            return
        last = now
        rate = done / (now - start) if now > start else 0.0
        left = f", {_left((total - done) / rate)}" if done >= min(_TOLD_FROM, total) and rate else ""
        speed = f", {_rate(rate)}" if rate else ""
        with suppress(OSError, ValueError):
            stderr.write(f"{title}{f' {note}' if note else ''}: {done:,} of {total:,}{speed}{left}\n")
            stderr.flush()

    return tell


def _left(seconds: float) -> str:
    return f"about {seconds / 60:.0f} min left" if seconds >= 60 else "less than a minute left"


def _rate(per_s: float) -> str:
    return f"{per_s:.1f}/s" if per_s >= 1 else f"{60 * per_s:.1f}/min"


def part_lines(stderr: TextIO, title: str) -> Callable[[str], None]:
    """Names parts of the work, a line each as it begins, on a `stderr` that is no terminal and so shows no bar.

    A line that cannot be written stops no work.

    Args:
        stderr: Where the lines go.
        title: What is done with each part.
    """
    announced: set[str] = set()

    def tell(part: str) -> None:
        if part in announced or stderr.isatty():
            return
        announced.add(part)
        with suppress(OSError, ValueError):
            stderr.write(f"{title} {part}\n")
            stderr.flush()

    return tell
