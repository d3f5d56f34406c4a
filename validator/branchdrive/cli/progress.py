"""Progress of long work: on a terminal a bar with counts, elapsed time and an ETA, elsewhere a line for each part."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Protocol, TextIO

from branchdrive.runtime.progress import unwatched

__all__ = ["Update", "part_lines", "progress_bar"]


class Update(Protocol):
    """Shows how far the work is; `note` stands beside the count."""

    def __call__(self, done: int, total: int, note: str = "") -> None:
        """Show `done` of `total`."""


@contextmanager
def progress_bar(stderr: TextIO, title: str) -> Iterator[Update]:
    """A progress bar on `stderr` if that is a terminal, nothing elsewhere; gone when the work is over."""
    if not stderr.isatty():
        yield unwatched
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn(title),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(file=stderr), transient=True) as bar:
        task = bar.add_task(title, total=None, note="")
        yield lambda done, total, note="": bar.update(task, completed=done, total=total, note=note)


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
