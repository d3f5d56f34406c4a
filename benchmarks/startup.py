"""Start-up cost of the light core, in fresh processes."""

from __future__ import annotations

import statistics
import subprocess
import time
from collections.abc import Iterator

from benchmarks.row import Row
from branchdrive.runtime.process import python_command

__all__ = ["rows", "time_startup"]


def time_startup(arguments: list[str], *, repeats: int = 5) -> float:
    """Median wall seconds of ``python`` with `arguments`, the first run left out."""
    seconds = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        subprocess.run(python_command(*arguments), check=True, capture_output=True)  # noqa: S603
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds[1:])


def rows() -> Iterator[Row]:
    """What importing the library and asking for help cost a user."""
    python = time_startup(["-c", "pass"])
    imported, validating = (
        time_startup(["-c", code]) - python for code in ("import branchdrive", "from branchdrive import validate")
    )
    yield Row("import branchdrive (and all of validate)", f"{imported:.2f} s ({validating:.2f} s)", "<= 0.4 s")
    yield Row("branchdrive --help", f"{time_startup(['-m', 'branchdrive.cli', '--help']):.2f} s", "<= 0.3 s")
