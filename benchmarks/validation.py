"""Validation against its floor: reading, hashing and decoding the same bytes with as many workers.

A gross ratio is that of whole times. Start-up of a raw layer is measured by itself, as what both take on as many groups
as there are workers, and its net ratio is that of what is above. What takes less than start-up does is run in one
worker instead, once before it is timed: a difference of times that are nearly equal would say nothing.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass
from math import log
from pathlib import Path

from benchmarks import sql_checker
from benchmarks.command import run_branchdrive
from benchmarks.cost import Cost, cost_of
from benchmarks.floor import layer_folders, read_folder
from benchmarks.repeated import repeat_dataset
from benchmarks.row import Row
from benchmarks.worker_peak import worker_peak_bytes
from branchdrive.benchmark.protocol.protocol import default_protocol
from branchdrive.engine.validate import validate
from branchdrive.errors import BranchDriveError
from branchdrive.runtime.executor import Executor, in_process, isolated, results_of
from branchdrive_reference.collect.campaign import collect

__all__ = ["ValidationTiming", "rows", "time_validation", "time_warm"]

_SEED = 7
_COLLECTED_GROUPS = 32
_GROUPS_PER_SHARD = 32
_GROWTH_PARTS = (4, 2)
"""Parts of the groups that growth is measured over, before all of them."""
_PEAK_GROUPS = (32, 64, 128)
_FILMED_GROUPS = 4
_GROSS_BARS = {1: "<= 2.2x", 2: "<= 1.6x"}
_NET_BARS = {1: "<= 4x", 2: ""}


@dataclass(frozen=True)
class ValidationTiming:
    """Medians over repeats; the workers' start-up is in both.

    Attributes:
        floor: Read + SHA-256 of every file of a layer, and decode of every table and image.
        validation: The whole validation.
        num_control_rows: Size of the dataset.
    """

    jobs: int
    floor: Cost
    validation: Cost
    num_control_rows: int

    @property
    def ratio(self) -> str:
        """Validation as a multiple of the floor, on the clock and of processors."""
        return self.validation.over(self.floor)

    def net_of(self, start_up: ValidationTiming) -> ValidationTiming:
        """What is left without what a dataset takes that holds next to nothing."""
        floor, validation = self.floor - start_up.floor, self.validation - start_up.validation
        return ValidationTiming(self.jobs, floor, validation, self.num_control_rows - start_up.num_control_rows)


def time_validation(root: Path, *, jobs: int, repeats: int = 3) -> ValidationTiming:
    """Time validation and floor in turn, so that both see the same machine.

    Raises:
        BranchDriveError: The dataset is not valid, so its timing would mean nothing.
    """
    return _timed(root, lambda: isolated(jobs), jobs, repeats)


def time_warm(root: Path, *, repeats: int = 3) -> ValidationTiming:
    """Time both in one worker that ran both before, and has what they keep of constants, such as quantiles.

    Raises:
        BranchDriveError: The dataset is not valid, so its timing would mean nothing.
    """
    (timing,) = results_of(isolated(1), _warm, [(root, repeats)], "timing a validation")
    return timing


def _warm(task: tuple[Path, int]) -> ValidationTiming:
    root, repeats = task
    _timed(root, lambda: in_process, 1, 1)
    return _timed(root, lambda: in_process, 1, repeats)


def _timed(root: Path, executor: Callable[[], Executor], jobs: int, repeats: int) -> ValidationTiming:
    """Timing with an executor of its own for each validation and each floor."""
    folders = layer_folders(root)
    num_rows = 0

    def floor() -> None:
        nonlocal num_rows
        num_rows = sum(results_of(executor(), read_folder, folders, "the floor"))

    def whole() -> None:
        report = validate(root, executor=executor())
        if report.verdict != "valid":
            raise BranchDriveError(f"the benchmark's dataset is {report.verdict}")

    floor_costs, validation_costs = [], []
    for _ in range(repeats):
        floor_costs.append(cost_of(floor))
        validation_costs.append(cost_of(whole))
    return ValidationTiming(jobs, Cost.median(floor_costs), Cost.median(validation_costs), num_rows)


def rows(folder: Path, *, num_groups: int, release: Path, repeats: int = 3) -> Iterator[Row]:
    """Validation of raw layers below `folder`, of at least `num_groups` groups and of fewer, and of a release.

    Args:
        folder: Where a collection is made, and repeated.
        num_groups: Groups of the largest raw layer.
        release: A release without a benchmark.
        repeats: Repeats of each time.
    """
    source, one = folder / "source", folder / "one"
    collect(source, num_groups=_COLLECTED_GROUPS, seed=_SEED)
    collect(one, num_groups=1, seed=_SEED)
    start_ups = {jobs: _start_up(one, folder, jobs, repeats) for jobs in (1, 2)}
    whole = yield from _whole(source, folder / "dataset", num_groups, start_ups, repeats)
    yield from _growth(source, folder, num_groups, whole, start_ups[1], repeats)
    yield from _peaks(source, folder)
    films = _filmed(folder)
    yield from _small_rows("raw layer with images, all decoded", films, repeats, net="<= 1.7x")
    yield from _small_rows("release", release, repeats, net="<= 6x")
    judged = _benchmarked(folder, release)
    yield from _small_rows("release with a benchmark", judged, repeats, net="<= 8x")


def _start_up(one: Path, folder: Path, jobs: int, repeats: int) -> ValidationTiming:
    """Timing of a dataset with one group for each worker."""
    target = folder / f"start-up-{jobs}"
    repeat_dataset(one, target, num_groups=jobs, groups_per_shard=1)
    return time_validation(target, jobs=jobs, repeats=repeats)


def _whole(
    source: Path, target: Path, num_groups: int, start_ups: Mapping[int, ValidationTiming], repeats: int
) -> Generator[Row, None, tuple[int, ValidationTiming]]:
    """The raw layer with one worker and with two; returns its groups, and its timing with one."""
    size = repeat_dataset(source, target, num_groups=num_groups, groups_per_shard=_GROUPS_PER_SHARD)
    timings = {jobs: time_validation(target, jobs=jobs, repeats=repeats) for jobs in start_ups}
    for jobs, timing in timings.items():
        workers = f"{jobs} worker{'s' * (jobs > 1)}"
        start = start_ups[jobs]
        yield Row(f"start-up, {workers}", f"validation {start.validation}\nfloor {start.floor}")
        what = f"raw layer, {size:,} groups, {workers}"
        yield _ratio_row(f"{what}\ngross", timing, _GROSS_BARS[jobs])
        yield _ratio_row(f"{what}\nnet of start-up", timing.net_of(start), _NET_BARS[jobs])
    gain = timings[1].validation.wall_s / timings[2].validation.wall_s
    yield Row("two workers over one, gross", f"{gain:.2f}x", ">= 1.8x")
    return size, timings[1]


def _small_rows(what: str, root: Path, repeats: int, *, net: str) -> Iterator[Row]:
    """Ratios of what takes no longer than start-up."""
    yield _ratio_row(f"{what}, 1 worker\ngross", time_validation(root, jobs=1, repeats=repeats), "")
    yield _ratio_row(f"{what}\nin a warm worker", time_warm(root, repeats=repeats), net)


def _ratio_row(what: str, timing: ValidationTiming, bar: str) -> Row:
    figures = f"{timing.ratio}\nvalidation {timing.validation}\nfloor {timing.floor}"
    return Row(f"{what}, over read + hash + decode", figures, bar)


def _growth(
    source: Path,
    folder: Path,
    num_groups: int,
    whole: tuple[int, ValidationTiming],
    start_up: ValidationTiming,
    repeats: int,
) -> Iterator[Row]:
    """Processor time for each group of raw layers with a quarter, a half and all groups; SQL on the smallest."""
    timings: dict[int, ValidationTiming] = {}
    roots: list[Path] = []
    for part in _GROWTH_PARTS:
        roots.append(folder / f"part-{part}")
        size = repeat_dataset(source, roots[-1], num_groups=num_groups // part, groups_per_shard=_GROUPS_PER_SHARD)
        timings[size] = time_validation(roots[-1], jobs=1, repeats=repeats)
    timings |= [whole]
    cpu_ms = {size: 1000 * timing.net_of(start_up).validation.cpu_s / size for size, timing in timings.items()}
    (smallest, least_ms), *_, (largest, most_ms) = cpu_ms.items()
    figures = f"{', '.join(f'{one:.1f}' for one in cpu_ms.values())} ms"
    if min(least_ms, most_ms) > 0:  # few groups may take less than start-up does from one time to the next
        figures += f"\nexponent {1 + log(most_ms / least_ms) / log(largest / smallest):.2f}"
    what = f"growth over {', '.join(map(str, cpu_ms))} groups, 1 worker\nnet CPU time for each group"
    yield Row(what, figures, "<= 1.1" if "exponent" in figures else "")
    yield from sql_checker.rows(roots[0], num_groups=smallest)


def _peaks(source: Path, folder: Path) -> Iterator[Row]:
    """Memory of a worker by groups of a shard, and what each of them takes."""
    peaks_mib = []
    for num_groups in _PEAK_GROUPS:
        target = folder / f"shard-of-{num_groups}"
        repeat_dataset(source, target, num_groups=num_groups, groups_per_shard=num_groups)
        peaks_mib.append(worker_peak_bytes(target) / 2**20)
    each_mib = (peaks_mib[-1] - peaks_mib[0]) / (_PEAK_GROUPS[-1] - _PEAK_GROUPS[0])
    shown = ", ".join(f"{one:.0f}" for one in peaks_mib)
    yield Row(f"worker's peak, shards of {', '.join(map(str, _PEAK_GROUPS))} groups", f"{shown} MiB")
    yield Row("worker's peak for each group of a shard", f"{each_mib:.1f} MiB", "<= 3 MiB")


def _filmed(folder: Path) -> Path:
    """A small raw layer with six views and bird's-eye views."""
    root, source = folder / "filmed", folder / "unfilmed"
    collect(source, num_groups=_FILMED_GROUPS, seed=_SEED)
    _run("render", str(source), "--output", str(root), "--jobs", "2")
    return root


def _benchmarked(folder: Path, release: Path) -> Path:
    """A copy of a release with a benchmark of models that are hardly trained: what is judged is as large as ever."""
    root, protocol = folder / "benchmarked", folder / "trial.json"
    shutil.copytree(release, root)
    document = default_protocol().document | {"name": "trial"}
    for model in document["models"]:
        model["configuration"]["training"]["max_epochs"] = 2
    protocol.write_text(json.dumps(document), encoding="utf-8")
    _run("benchmark", str(root), "--protocol", str(protocol), "--no-figures", "--jobs", "2")
    return root


def _run(command: str, *arguments: str) -> None:
    found = run_branchdrive(command, *arguments)
    if found.exit_code != 0:
        raise BranchDriveError(f"`branchdrive {command}` ended with {found.exit_code}: {found.output}")
