"""A command with its wall time and the peak memory of its processes, read from `/proc` while it runs."""

from __future__ import annotations

import re
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from branchdrive.runtime.process import child_environment

__all__ = ["Measured", "peak_bytes", "process_tree", "reset_peak", "run_measured"]

_PROC = Path("/proc")
_SAMPLE_S = 0.5


@dataclass(frozen=True)
class Measured:
    """A command that has ended.

    Attributes:
        exit_code: What it returned.
        output: What it wrote to standard output.
        wall_s: Wall time.
        main_bytes: Peak resident memory of the process that was started.
        worker_bytes: The same of the largest process that descends from it; 0 where there is none.
        together_bytes: Largest sum, over the processes alive at one sample, of their peaks until then.
    """

    exit_code: int
    output: str
    wall_s: float
    main_bytes: int
    worker_bytes: int
    together_bytes: int

    @property
    def largest_bytes(self) -> int:
        """Peak resident memory of its largest process."""
        return max(self.main_bytes, self.worker_bytes)


def _parents() -> Iterator[tuple[int, int]]:
    """Every process with its parent."""
    for path in _PROC.glob("[0-9]*/stat"):
        with suppress(OSError):
            yield int(path.parent.name), int(path.read_text(encoding="utf-8").rpartition(")")[2].split()[1])


def process_tree(root: int) -> set[int]:
    """A process and all that descend from it."""
    children: dict[int, list[int]] = {}
    for pid, parent in _parents():
        children.setdefault(parent, []).append(pid)
    found, waiting = set(), [root]
    while waiting:
        pid = waiting.pop()
        found.add(pid)
        waiting += children.get(pid, [])
    return found


def peak_bytes(pid: int) -> int:
    """Peak resident memory of a process since it began or was reset, 0 if it has ended."""
    with suppress(OSError):
        found = re.search(r"VmHWM:\s+([0-9]+) kB", Path(_PROC, str(pid), "status").read_text(encoding="utf-8"))
        return int(found[1]) * 1024 if found else 0
    return 0


def reset_peak(pid: int) -> None:
    """Restart the peak of a process at what it holds now; where the system cannot do that, the old peak stays."""
    with suppress(OSError):
        Path(_PROC, str(pid), "clear_refs").write_text("5", encoding="ascii")


def run_measured(command: Sequence[str], *, sample_s: float = _SAMPLE_S) -> Measured:
    """Run a command to its end and sample its processes every `sample_s` seconds; its errors go to the terminal."""
    main, worker, together = 0, 0, 0
    start_s = time.perf_counter()
    environment = child_environment()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:  # noqa: S603
        while True:
            peaks = {pid: peak_bytes(pid) for pid in process_tree(process.pid)}
            together = max(together, sum(peaks.values()))
            main = max(main, peaks.pop(process.pid))
            worker = max(worker, *peaks.values(), 0)
            with suppress(subprocess.TimeoutExpired):
                output, _ = process.communicate(timeout=sample_s)
                break
    return Measured(process.returncode, output, time.perf_counter() - start_s, main, worker, together)
