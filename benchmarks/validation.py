"""Validation against its floor: reading, hashing and decoding the same bytes with as many workers."""

from __future__ import annotations

import hashlib
import re
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.corpus import repeat_dataset
from benchmarks.row import Row
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.layout import RAW_DIR
from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.shard import ShardTask, audit_shard
from branchdrive.engine.validate import validate
from branchdrive.errors import BranchDriveError
from branchdrive.files.survey import take_survey
from branchdrive.formats.folder import Folder
from branchdrive.formats.untrusted_parquet import decode_table
from branchdrive.runtime.executor import isolated
from branchdrive_reference.collect.campaign import collect

__all__ = ["ValidationTiming", "rows", "time_validation", "worker_peak_bytes"]

_SEED = 7
_COLLECTED_GROUPS = 32
_GROUPS_PER_SHARD = 32


@dataclass(frozen=True)
class ValidationTiming:
    """Medians over repeats, wall seconds; the workers' start-up is in both.

    Attributes:
        floor_s: Read + SHA-256 of every file of a layer, and decode of every table.
        validation_s: The whole validation.
        num_control_rows: Size of the dataset.
    """

    jobs: int
    floor_s: float
    validation_s: float
    num_control_rows: int

    @property
    def ratio(self) -> float:
        """Validation time as a multiple of the floor."""
        return self.validation_s / self.floor_s


def _floor(folder: Path) -> int:
    num_rows = 0
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        content = path.read_bytes()
        hashlib.sha256(content).hexdigest()
        if path.suffix == ".parquet":
            table = decode_table(content, path.stem)
            num_rows += table.num_rows if path.stem == "controls" else 0
    return num_rows


def _folders(root: Path) -> list[Path]:
    """Shards and derived layers of a dataset."""
    layers = [root / name for name in LAYERS]
    return [*sorted((root / RAW_DIR).iterdir()), *(layer for layer in layers if layer.is_dir())]


def _tasks(root: Path) -> list[ShardTask]:
    survey = take_survey(Folder(root))
    return [
        ShardTask(
            survey.folder, folder, tuple(file.path for file in files), survey.descriptor, frozenset(CATALOGUE), True
        )
        for folder, files in survey.shard_folders.items()
    ]


def _peak_bytes(task: ShardTask) -> int:
    """Largest resident memory of this process after auditing a shard.

    Read from `/proc`: resource usage would count what the parent held when it started the process.
    """
    audit_shard(task)
    peak = re.search(r"VmHWM:\s+([0-9]+) kB", Path("/proc/self/status").read_text(encoding="ascii"))
    return int(peak[1]) * 1024 if peak else 0


def _seconds(action: Callable[[], object]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def time_validation(root: Path, *, jobs: int, repeats: int = 3) -> ValidationTiming:
    """Time validation and floor in turn, so that both see the same machine.

    Raises:
        BranchDriveError: The dataset is not valid, so its timing would mean nothing.
    """
    folders = _folders(root)
    num_rows = 0

    def floor() -> None:
        nonlocal num_rows
        num_rows = sum(rows for _, rows in isolated(jobs)(_floor, folders) if isinstance(rows, int))

    def whole() -> None:
        report = validate(root, executor=isolated(jobs))
        if report.verdict != "valid":
            raise BranchDriveError(f"the benchmark's dataset is {report.verdict}")

    floor_s, validation_s = [], []
    for _ in range(repeats):
        floor_s.append(_seconds(floor))
        validation_s.append(_seconds(whole))
    return ValidationTiming(jobs, statistics.median(floor_s), statistics.median(validation_s), num_rows)


def worker_peak_bytes(root: Path) -> int:
    """Largest resident memory of a worker that audits every shard of a raw layer in turn."""
    return max(peak for _, peak in isolated(1)(_peak_bytes, _tasks(root)) if isinstance(peak, int))


def rows(folder: Path, *, num_groups: int) -> Iterator[Row]:
    """Time and memory of validating at least `num_groups` groups: a collection below `folder`, repeated."""
    source, target = folder / "source", folder / "dataset"
    collect(source, num_groups=_COLLECTED_GROUPS, seed=_SEED)  # no workers: their memory is not to be measured
    size = repeat_dataset(source, target, num_groups=num_groups, groups_per_shard=_GROUPS_PER_SHARD)
    for jobs in (1, 2):
        timing = time_validation(target, jobs=jobs)
        what = f"{size:,} groups, {timing.num_control_rows / 1e6:.1f} M control rows, {jobs} worker(s)"
        measured = f"{timing.validation_s:.2f} s / {timing.floor_s:.2f} s = {timing.ratio:.2f}x"
        yield Row(f"validation / (read + hash + decode)\n{what}", measured, "<= 2.5x")
    yield Row("peak memory of a worker", f"{worker_peak_bytes(target) / 2**20:.0f} MiB", "<= 512 MiB")
