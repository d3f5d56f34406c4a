"""Validation elsewhere over validation of a folder by this machine: from a bucket, from a cache, on Ray.

``python -m benchmarks.places serve FOLDER`` is the bucket, on loopback and in a process of its own, whose time is not
counted; ``python -m benchmarks.places pool|ray FOLDER`` measures one validation with all processes that it starts.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TextIO, cast

import pyarrow.parquet as pq

from benchmarks.command import run_module
from benchmarks.cost import Cost, cost_of
from benchmarks.memory import process_tree
from benchmarks.repeated import repeat_dataset
from benchmarks.row import Row
from branchdrive.contract.columns import TABLES
from branchdrive.contract.layout import RAW_DIR, shard_name
from branchdrive.engine.cache import Cache
from branchdrive.engine.report import Report
from branchdrive.engine.validate import validate
from branchdrive.errors import BranchDriveError
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive.formats.place import Place
from branchdrive.runtime.executor import Executor, in_process, isolated
from branchdrive.runtime.process import python_command
from branchdrive.runtime.ray_executor import ray_executor
from branchdrive_reference.collect.campaign import collect

__all__ = ["main", "rows"]

NUM_SHARDS = 100
_GROUPS_PER_SHARD = 2
_SEED = 7
_ROWS = 1000
"""Of a row group, in a shard that is changed."""
_ENVIRONMENT = {"AWS_ACCESS_KEY_ID": "bench", "AWS_SECRET_ACCESS_KEY": "bench", "AWS_REGION": "us-east-1"}


@dataclass(frozen=True)
class _Bucket:
    """The server: it tells how many requests it had when a line is written to it."""

    asked: TextIO
    answers: TextIO

    def answer(self) -> str:
        """The next line that it writes."""
        return self.answers.readline().strip()

    @property
    def num_requests(self) -> int:
        """Requests until now."""
        self.asked.write("\n")
        self.asked.flush()
        return int(self.answer())


@contextmanager
def _bucket(root: Path) -> Iterator[_Bucket]:
    """A bucket with the files of a folder below `drive`, which the environment names."""
    command = python_command("-m", __name__, "serve", str(root))
    path = os.pathsep.join(sys.path)
    with subprocess.Popen(  # noqa: S603
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": path}
    ) as process:
        bucket, before = _Bucket(cast("TextIO", process.stdin), cast("TextIO", process.stdout)), dict(os.environ)
        try:
            os.environ |= {**_ENVIRONMENT, "AWS_ENDPOINT_URL": bucket.answer()}
            yield bucket
        finally:
            os.environ.clear()
            os.environ |= before
            process.kill()


def rows(folder: Path, *, num_shards: int = NUM_SHARDS, repeats: int = 2) -> Iterator[Row]:
    """A raw layer of small shards below `folder`, validated in each way; times are the least of `repeats`, in turn."""
    source, root = folder / "few", folder / "shards"
    collect(source, num_groups=_GROUPS_PER_SHARD, seed=_SEED)
    repeat_dataset(source, root, num_groups=num_shards * _GROUPS_PER_SHARD, groups_per_shard=_GROUPS_PER_SHARD)
    size = f"{num_shards} shards of {_GROUPS_PER_SHARD} groups"
    with _bucket(root) as bucket:
        full, there, num_requests = [], [], 0
        for _ in range(repeats):
            full.append(cost_of(lambda: _validated(root)))
            before = bucket.num_requests
            there.append(cost_of(lambda: _validated("s3://bucket/drive")))
            num_requests = bucket.num_requests - before
    floor = _least(full)
    yield Row(f"{size}, folder, 1 process", str(floor))
    yield Row(
        f"{size}, bucket on loopback over folder\nrequests a shard, of {len(TABLES)} tables at most",
        f"{_least(there).over(floor)}\n{num_requests / num_shards:.2f}",
        "<= 1.5x CPU",
    )
    yield from _cached(folder / "cache", root, size, floor, repeats)
    yield _on_ray(root, size)


def _cached(cache: Path, root: Path, size: str, floor: Cost, repeats: int) -> Iterator[Row]:
    _validated(root, cache=Cache(cache))
    taken = _least([cost_of(lambda: _validated(root, cache=Cache(cache))) for _ in range(repeats)])
    changed = []
    for number in range(repeats):
        _change(root, number)
        changed.append(cost_of(lambda: _validated(root, cache=Cache(cache))))
    for what, cost, bar in (("all taken", taken, ""), ("one shard changed", _least(changed), "<= 5 %")):
        yield Row(f"{size}, cache, {what}\nCPU time of a full run", f"{100 * cost.cpu_s / floor.cpu_s:.1f} %", bar)


def _change(root: Path, number: int) -> None:
    """Give a shard other bytes of the same rows."""
    path = root / RAW_DIR / shard_name(number) / TABLES["controls"].file_name
    pq.write_table(pq.read_table(path), path, row_group_size=_ROWS)
    write_manifest(Folder(root), build_manifest(Folder(root)))


def _on_ray(root: Path, size: str) -> Row:
    what, bar = f"{size}, Ray over pool, 1 worker\nCPU time of all processes, without their start", "<= 1.2x"
    if find_spec("ray") is None:
        return Row(what, "not measured: pip install '.[ray]'", bar)
    spent = {}
    for engine in ("pool", "ray"):
        measured = run_module(__name__, engine, str(root))
        if measured.exit_code != 0:
            raise BranchDriveError(f"validating by {engine} ended with {measured.exit_code}")
        spent[engine] = float(measured.output)
    return Row(what, f"{spent['ray'] / spent['pool']:.2f}x ({spent['pool']:.1f} and {spent['ray']:.1f} CPU-s)", bar)


def _validated(place: Place, cache: Cache | None = None, executor: Executor = in_process) -> Report:
    report = validate(place, cache=cache, executor=executor)
    if report.verdict != "valid":
        raise BranchDriveError(f"the verdict on repeated shards is {report.verdict}")
    return report


def _least(costs: list[Cost]) -> Cost:
    return min(costs, key=lambda cost: cost.cpu_s)


def _spent_s() -> float:
    """Processor seconds of this process, of all that descend from it, and of those that they have waited for."""
    ticks = 0
    for pid in process_tree(os.getpid()):
        with suppress(OSError):
            ticks += sum(map(int, Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:15]))
    return ticks / os.sysconf("SC_CLK_TCK")


def main(what: str, folder: str) -> None:
    """Be the bucket, or measure a validation and print its processor seconds."""
    if what == "serve":
        from tests.bucket_server import serving

        with serving() as server:
            server.fill(Path(folder), "drive")
            print(server.url, flush=True)  # noqa: T201
            for _ in sys.stdin:
                print(len(server.requests), flush=True)  # noqa: T201
        return
    executor = isolated(1) if what == "pool" else ray_executor(jobs=1)
    list(executor(len, ["start"]))
    before = _spent_s()
    _validated(folder, executor=executor)
    sys.stdout.write(str(_spent_s() - before))


if __name__ == "__main__":
    main(*sys.argv[1:])
