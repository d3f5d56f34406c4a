"""Start-up cost of the light core, in fresh processes."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time

__all__ = ["time_startup"]


def time_startup(arguments: list[str], *, repeats: int = 5) -> float:
    """Median wall seconds of ``python`` with `arguments`, the first run left out."""
    seconds = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True)  # noqa: S603
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds[1:])
