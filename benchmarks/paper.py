"""A collection of the paper's size: collected and validated by the command line, as a user would.

Time and memory are those of the commands with all their worker processes.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

from benchmarks.command import minutes, run_branchdrive, size
from benchmarks.memory import Measured
from benchmarks.row import Row
from branchdrive.errors import BranchDriveError
from branchdrive.exit_code import EXIT_FAILED, EXIT_OF_VERDICT

__all__ = ["rows"]

_SEED = 7
_JOBS = 2


def _memory(measured: Measured) -> str:
    largest, together = measured.largest_bytes / 2**20, measured.together_bytes / 2**20
    return f"{largest:,.0f} MiB the largest process, {together:,.0f} MiB all together"


def rows(folder: Path, *, num_groups: int | None = None, jobs: int = _JOBS) -> Iterator[Row]:
    """Collect the preset `paper` below `folder` and validate it.

    Args:
        folder: An empty folder with room for the dataset.
        num_groups: Groups to collect instead of the preset's.
        jobs: Worker processes of either command.

    Raises:
        BranchDriveError: A command failed, or its report lacks a figure.
    """
    dataset = str(folder / "dataset")
    options = ("--preset", "paper", "--seed", str(_SEED), "--jobs", str(jobs))
    collected = run_branchdrive("collect", dataset, *options, *(("--groups", str(num_groups)) if num_groups else ()))
    speed = re.search(r"^ticks +([0-9,]+) in .* ([0-9,]+) ticks/s$", collected.output, re.M)
    if collected.exit_code != 0 or speed is None:
        raise BranchDriveError(f"`branchdrive collect` ended with {collected.exit_code}: {collected.output}")
    what = f"{num_groups:,} groups of preset `paper`" if num_groups else "preset `paper`"
    yield Row(f"collect {what}, {jobs} worker(s)", minutes(collected.wall_s), "<= 60 min")
    yield Row("ticks, writing included", f"{speed[1]} at {speed[2]} ticks/s")
    yield Row("peak memory of the collector and its workers", _memory(collected), "<= 2 GiB")

    validated = run_branchdrive("validate", dataset, "--jobs", str(jobs), "--format", "json")
    if validated.exit_code not in set(EXIT_OF_VERDICT.values()) - {EXIT_FAILED}:
        raise BranchDriveError(f"`branchdrive validate` ended with {validated.exit_code}")
    report = json.loads(validated.output)
    figures = f"{minutes(validated.wall_s)}, {report['verdict']}"
    yield Row(f"validate them, {jobs} worker(s)\n{size(report['dataset'])}", figures, "<= 60 min")
    yield Row("peak memory of the validator and its workers", _memory(validated), "<= 2 GiB")
    if report["funnel"]:
        stages = (f"{stage['groups']:,} {stage['title'].lower()}" for stage in report["funnel"]["stages"])
        yield Row("funnel", "\n".join(stages))
