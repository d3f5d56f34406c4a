"""How stages of a release grow with its groups: processor time and the parent's memory, on repeated shards.

``python -m benchmarks.growth STAGE FOLDER GROUPS JOBS`` measures one stage at one size in a process of its own.
`FOLDER` is a spool with an audited shard. Reading of shards is left out, as its growth is that of
`benchmarks.validation`; what it takes to repeat them is in, the same for each group.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from math import log
from pathlib import Path

from benchmarks.command import run_module
from benchmarks.cost import cost_of
from benchmarks.memory import peak_bytes, reset_peak
from benchmarks.repeated import AuditedShard, Repeating, audited_shard, repeated_dataset
from benchmarks.row import Row
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.layer import table_path
from branchdrive.contract.layout import RAW_DIR, shard_name
from branchdrive.engine.spool import Spool
from branchdrive.engine.validate import validate
from branchdrive.errors import BranchDriveError
from branchdrive.formats.manifest import Manifest, parse_manifest
from branchdrive.leakage.protocol import AuditProtocol, BatteryProtocol, GateProtocol
from branchdrive.release.builder import build_release
from branchdrive.release.stage import BuildOptions
from branchdrive.runtime.executor import in_process, isolated

__all__ = ["ALL_STAGES", "LARGE_SIZES", "SIZES", "STAGES", "StageCost", "main", "measure", "rows"]

SIZES = (1_000, 4_000)
LARGE_SIZES = (1_000, 4_000, 16_000)
"""Groups at which stages are measured."""

STAGES = ("validate", "build")
ALL_STAGES = (*STAGES, "audit")
"""What is measured."""

_MANIFEST_GROUPS = 1_000_000
_SHARD = "shard"
_FEW_DRAWS = AuditProtocol(
    GateProtocol(
        num_permutations=99, num_frequencies=50, num_replicates=1, offsets_sd=(0.8,), sparse_offsets_sd=(3.0,)
    ),
    BatteryProtocol(num_permutations=99, num_resamples=99),
)
_BUILT = ("canonical", "quality", "model")
_TITLES = {
    "validate": "validation in the parent",
    "build": "build without an audit",
    "audit": "audit with 99 permutations",
}


@dataclass(frozen=True)
class StageCost:
    """What a stage took.

    Attributes:
        num_groups: Its groups.
        cpu_s: Processor time of all processes.
        parent_bytes: By how much the peak of the parent's memory rose.
    """

    num_groups: int
    cpu_s: float
    parent_bytes: int


def measure(stage: str, shard: AuditedShard, folder: Path, num_groups: int, jobs: int) -> StageCost:
    """Cost of a stage on a dataset of repeated shards, which is written below `folder`.

    Raises:
        BranchDriveError: The stage failed.
    """
    root, executor = folder / "dataset", Repeating(shard, isolated(jobs))
    size = repeated_dataset(shard, root, num_groups)

    def build(stages: Sequence[str]) -> None:
        build_release(root, stages=stages, options=BuildOptions(1), protocol=_FEW_DRAWS, executor=executor)

    def judge() -> None:
        report = validate(root, executor=executor)
        if report.verdict != "valid":
            raise BranchDriveError(f"the verdict on {size} repeated groups is {report.verdict}")

    actions: dict[str, Callable[[], None]] = {
        "validate": judge,
        "build": lambda: build(_BUILT),
        "audit": lambda: build(["leakage"]),
    }
    if stage == "audit":
        build(_BUILT[:2])
    reset_peak(os.getpid())
    before = peak_bytes(os.getpid())
    cost = cost_of(actions[stage])
    return StageCost(size, cost.cpu_s, peak_bytes(os.getpid()) - before)


def rows(folder: Path, *, sizes: Sequence[int] = SIZES, stages: Sequence[str] = STAGES, jobs: int = 2) -> Iterator[Row]:
    """Growth of stages below `folder`.

    Args:
        folder: Holds a dataset `source`, which is collected already.
        sizes: Groups, at least two sizes in ascending order.
        stages: What is measured: by default all but the audit, which takes minutes.
        jobs: Worker processes.

    Raises:
        BranchDriveError: A stage failed.
    """
    shards = folder / "audited"
    shards.mkdir()
    Spool(shards).put(_SHARD, audited_shard(folder / "source", in_process))
    for stage in stages:
        costs = []
        for size in sizes:
            measured = run_module("benchmarks.growth", stage, str(shards), str(size), str(jobs))
            if measured.exit_code != 0:
                raise BranchDriveError(f"the stage {stage!r} at {size} groups ended with {measured.exit_code}")
            costs.append(StageCost(**json.loads(measured.output)))
        yield _row(_TITLES[stage], costs, jobs)
    yield _manifest(_MANIFEST_GROUPS)


def _row(title: str, costs: Sequence[StageCost], jobs: int) -> Row:
    first, last = costs[0], costs[-1]
    exponent = log(last.cpu_s / first.cpu_s) / log(last.num_groups / first.num_groups)
    each_kb = (last.parent_bytes - first.parent_bytes) / (last.num_groups - first.num_groups) / 1000
    shown = ", ".join(f"{1000 * cost.cpu_s / cost.num_groups:.1f}" for cost in costs)
    sizes = ", ".join(f"{cost.num_groups:,}" for cost in costs)
    return Row(
        f"growth of {title}, {sizes} groups, {jobs} worker(s)\nCPU time for each group, parent's memory for each more",
        f"{shown} ms, exponent {exponent:.2f}\n{each_kb:.1f} kB",
        "<= 1.1\n<= 10 kB",
    )


def _manifest(num_groups: int) -> Row:
    """The manifest of a release of so many groups of 32 a shard, with as many parts as it has."""
    num_shards = num_groups // 32
    raw = [f"{RAW_DIR}/{shard_name(n)}/{name}.parquet" for n in range(num_shards) for name in "abcdefgh"]
    parts = [
        table_path(table.name, partition, part)
        for table in LAYER_TABLES.values()
        for partition in table.partitions or (None,)
        for part in range(num_shards // 64 if table.is_of_groups else 1)
    ]
    content: list[bytes] = []
    manifest = Manifest.of(dict.fromkeys([*raw, *parts], "0" * 64))
    made = cost_of(lambda: content.append(manifest.render()))
    read = cost_of(lambda: parse_manifest(content[0]))
    figures = f"{len(raw) + len(parts):,} files, {len(content[0]) / 1e6:.1f} MB\nwritten {made}, read {read}"
    return Row(f"manifest of {num_groups:,} groups", figures)


def main(stage: str, folder: str, num_groups: str, jobs: str) -> None:
    """Measure one stage and print it."""
    shard = Spool(Path(folder)).get(_SHARD)
    with tempfile.TemporaryDirectory(dir=folder) as target:
        try:
            cost = measure(stage, shard, Path(target), int(num_groups), int(jobs))
        except BranchDriveError as error:
            sys.exit(f"bench: {error}")
    sys.stdout.write(json.dumps(asdict(cost)))


if __name__ == "__main__":
    main(*sys.argv[1:])
