"""The frozen benchmark on a release: training, the guard, prediction, evaluation, and the statistics table alone."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.command import memory, minutes, run_branchdrive
from benchmarks.memory import Measured
from benchmarks.row import Row
from branchdrive.benchmark.prediction.inputs import ResultInputs
from branchdrive.benchmark.prediction.record import prediction_results
from branchdrive.benchmark.protocol.protocol import default_protocol
from branchdrive.errors import BranchDriveError
from branchdrive_reference.benchmark.document import read_protocol_file
from branchdrive_reference.benchmark.guard.fold import fold_tasks
from branchdrive_reference.benchmark.release import benchmark_data, open_release, published_predictions

__all__ = ["rows"]

_REPEATS = 3


def rows(root: Path, *, jobs: int, protocol_file: Path | None = None) -> Iterator[Row]:
    """Run the benchmark of the release in the folder `root`, step by step, each in a process of its own.

    Args:
        root: A release without a benchmark.
        jobs: Processes that train side by side.
        protocol_file: Another protocol than the default one.

    Raises:
        BranchDriveError: A step failed.
    """
    release = open_release(root)
    protocol = default_protocol() if protocol_file is None else read_protocol_file(protocol_file)
    data = benchmark_data(release)
    num_groups = len(data.part("train").groups)
    options = (str(root), "--jobs", str(jobs), *(() if protocol_file is None else ("--protocol", str(protocol_file))))
    trained = _run("train", *options, "--no-guard")
    names = ", ".join(model.id for model in protocol.models)
    what = f"train {names} with all their seeds on {num_groups:,} groups, {jobs} process(es)"
    yield Row(what, _cost(trained), "<= 120 s")
    folds = len(fold_tasks(release, protocol))
    guarded = _run("train", *options)
    yield Row(f"train the {folds} folds of the guard, and its risk", _cost(guarded))
    locked = _run("lock", str(root))
    predicted = _run("predict", str(root))
    yield Row("predict", _cost(predicted))
    evaluated = _run("evaluate", str(root))
    yield Row("evaluate: statistics, rankings, guard, tables and figures", _cost(evaluated))
    total_s = sum(step.wall_s for step in (trained, guarded, locked, predicted, evaluated))
    yield Row("all steps of the benchmark", minutes(total_s), "<= 240 s for 1,000 groups")
    inputs = ResultInputs.of(protocol, data, published_predictions(open_release(root), protocol, data))
    table_s = _seconds(lambda: prediction_results(inputs))
    what = f"statistics table\n{len(data.part('test').groups):,} groups of the test partition"
    yield Row(what, f"{table_s:.2f} s", "<= 2 s")


def _run(command: str, *arguments: str) -> Measured:
    found = run_branchdrive(command, *arguments)
    if found.exit_code != 0:
        raise BranchDriveError(f"`branchdrive {command}` ended with {found.exit_code}: {found.output}")
    return found


def _cost(found: Measured) -> str:
    return f"{minutes(found.wall_s)}\n{memory(found.main_bytes, found.worker_bytes)}"


def _seconds(action: Callable[[], object]) -> float:
    """Median wall time of a few runs."""
    found = []
    for _ in range(_REPEATS):
        begin = time.perf_counter()
        action()
        found.append(time.perf_counter() - begin)
    return statistics.median(found)
