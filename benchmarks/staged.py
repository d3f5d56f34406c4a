"""A build with wall time and peak memory of each of its stages, in a process of its own.

``python -m benchmarks.staged DATASET GROUPS,CLUSTERS JOBS`` builds in place and prints the stages
as JSON. Memory is read from `/proc`; the peak of the building process begins again with every stage.
"""

from __future__ import annotations

import json
import os
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Event, Thread

from benchmarks.memory import peak_bytes, process_tree, reset_peak
from branchdrive.cli.build import calibration
from branchdrive.errors import BranchDriveError
from branchdrive.release.builder import build_release
from branchdrive.release.stage import BuildOptions
from branchdrive.runtime.executor import isolated
from branchdrive.statistics.split import Calibration

__all__ = ["StageCost", "main"]

_SAMPLE_S = 0.1
_RAW = "raw"


@dataclass(frozen=True)
class StageCost:
    """What a stage took.

    Attributes:
        name: `raw` for reading, judging and extracting the raw layer; otherwise a stage of the build.
        wall_s: Wall time, publication included.
        main_bytes: Peak resident memory of the building process.
        worker_bytes: The same of its largest worker; 0 where there is none.
    """

    name: str
    wall_s: float
    main_bytes: int
    worker_bytes: int


class _Clock:
    """Divides the life of this process into stages; a thread watches the workers, which the first stage alone has."""

    def __init__(self) -> None:
        self.stages: list[StageCost] = []
        self._worker_bytes = 0
        self._over = Event()
        self._watch = Thread(target=self._sample, daemon=True)
        self._begin(_RAW)
        self._watch.start()

    def _begin(self, name: str) -> None:
        self._name, self._start_s = name, time.perf_counter()
        reset_peak(os.getpid())

    def _sample(self) -> None:
        while not self._over.wait(_SAMPLE_S):
            for pid in process_tree(os.getpid()) - {os.getpid()}:
                self._worker_bytes = max(self._worker_bytes, peak_bytes(pid))

    def note(self, name: str) -> None:
        """The stage `name` is at work."""
        if name != self._name:
            self.end()
            self._begin(name)

    def end(self) -> None:
        """The stage is over."""
        wall_s = time.perf_counter() - self._start_s
        self._over.set()
        self._watch.join()
        self.stages.append(StageCost(self._name, wall_s, peak_bytes(os.getpid()), self._worker_bytes))
        self._worker_bytes = 0


def main(root: str, least: str, jobs: str) -> None:
    """Build in place and print the stages."""
    clock = _Clock()
    try:
        build_release(
            Path(root),
            options=BuildOptions(calibration=Calibration(*calibration(least))),
            executor=isolated(int(jobs)),
            progress=lambda stage, *_: clock.note(stage),
        )
    except BranchDriveError as error:
        sys.exit(f"bench: {error}")
    clock.end()
    sys.stdout.write(json.dumps([asdict(stage) for stage in clock.stages]))


if __name__ == "__main__":
    main(*sys.argv[1:])
