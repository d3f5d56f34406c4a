"""The benchmarks measure something, and say what they lack."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from benchmarks.memory import Measured, peak_bytes, process_tree, reset_peak, run_measured
from benchmarks.release import ReleaseBench
from benchmarks.simulator import measure_ticks_per_s
from tests.content_cache import kept_folder
from tests.reference_impl.benchmark.small_release import invoke, make_release, smallest_protocol, write_protocol
from tests.reference_impl.collect.kept_collection import kept_collection
from tests.sampling import THOROUGH, sampled

from benchmarks import benchmark, highway_env, paper, ranking, release
from branchdrive.benchmark.protocol.protocol import default_protocol
from branchdrive.cli.main import run
from branchdrive.errors import BranchDriveError
from branchdrive.runtime.environment import install_command
from branchdrive_reference.benchmark.training import model_tasks

MIB = 2**20
HOLD = """
import sys, time
from pathlib import Path
held = bytearray(60 << 20)
while not Path(sys.argv[1]).exists():
    time.sleep(0.02)
"""
PARENT = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {HOLD!r}, sys.argv[1]]); print('over')"


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """A release without a benchmark."""
    return kept_folder("bare-release", make_release, tmp_path / "bare")


@THOROUGH
def test_speed_is_measured() -> None:
    assert measure_ticks_per_s(num_rollouts=2, repeats=1) > 0


def test_the_memory_of_a_command_is_that_of_its_tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    num_seen = 0

    def tree(root: int) -> set[int]:
        """Lets the worker go at the sample after one that has seen all of its memory."""
        nonlocal num_seen
        if num_seen:
            (tmp_path / "gate").touch()
        found = process_tree(root)
        num_seen += max(map(peak_bytes, found)) > 60 * MIB
        return found

    monkeypatch.setattr("benchmarks.memory.process_tree", tree)
    measured = run_measured([sys.executable, "-c", PARENT, str(tmp_path / "gate")], sample_s=0.05)
    assert (measured.exit_code, measured.output) == (0, "over\n")
    assert measured.wall_s > 0
    assert 60 * MIB < measured.largest_bytes == measured.worker_bytes < 90 * MIB
    assert 4 * MIB < measured.main_bytes < 40 * MIB
    assert measured.largest_bytes + 4 * MIB < measured.together_bytes < measured.largest_bytes + 40 * MIB


def test_a_peak_begins_anew() -> None:
    code = "held = bytearray(60 << 20); del held; print(flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        before = peak_bytes(process.pid)
        reset_peak(process.pid)
        assert peak_bytes(process.pid) + 50 * MIB < before
        process.communicate("\n")
    assert peak_bytes(process.pid) == 0


def test_highway_env_runs_with_as_many_vehicles() -> None:
    pytest.importorskip("highway_env")
    found = highway_env.compare(num_rollouts=1, num_ticks=5, repeats=1)
    assert found.their_vehicles == round(found.our_vehicles)
    assert found.ratio == found.ours_ticks_per_s / found.theirs_ticks_per_s > 0


def test_without_highway_env_its_row_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def lack(**_: object) -> None:
        raise ModuleNotFoundError(name="highway_env")

    monkeypatch.setattr(highway_env, "compare", lack)
    (row,) = highway_env.rows()
    assert row.measured == f"not measured, highway_env is not installed: {install_command('bench')}"
    assert row.bar == ">= 25x"


@pytest.mark.parametrize("has_processes", sampled([False, True], every=2))
def test_a_collection_is_measured_with_its_validation(
    tmp_path: Path, has_processes: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not has_processes:
        monkeypatch.setattr(paper, "run_branchdrive", run_in_this_process)
    rows = {row.what.splitlines()[0]: row for row in paper.rows(tmp_path, num_groups=1, jobs=1)}
    collected = rows["collect 1 groups of preset `paper`, 1 worker(s)"]
    assert re.fullmatch(r"[0-9.]+ s", collected.measured) and collected.bar == "<= 60 min"
    assert rows["peak memory of the collector and its workers"].bar == "<= 2 GiB"
    assert rows["funnel"].measured.splitlines()[0] == "1 groups discovered"


def run_in_this_process(command: str, *arguments: str) -> Measured:
    """A command and how it ends, without a process to measure."""
    stdout, stderr = io.StringIO(), io.StringIO()
    return Measured(run([command, *arguments], stdout, stderr), stdout.getvalue(), 0.1, peak_bytes(os.getpid()), 0, 0)


def test_a_collection_that_fails_is_no_measurement(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paper, "run_branchdrive", run_in_this_process)
    (tmp_path / "dataset").write_text("in the way")
    with pytest.raises(BranchDriveError, match="`branchdrive collect` ended with 2"):
        list(paper.rows(tmp_path, num_groups=1, jobs=1))


@pytest.mark.thorough
def test_a_release_is_measured_stage_by_stage(tmp_path: Path) -> None:
    source = kept_collection(tmp_path / "source", num_groups=6, seed=1)
    before = {path: path.read_bytes() for path in source.rglob("*") if path.is_file()}
    bench = ReleaseBench(source, calibration=(1, 1), num_seeds=2, repeats=1, jobs=1)
    rows = {row.what.splitlines()[0]: row for row in release.rows(tmp_path / "bench", bench)}
    stages = [name for name in rows if name.startswith("build: ")]
    assert [name.split()[-1] for name in stages] == ["layer", "canonical", "quality", "leakage", "model"]
    assert re.fullmatch(r"[0-9.]+ s\n[0-9]+ MiB, its largest worker [0-9]+ MiB", rows[stages[0]].measured)
    assert all(re.fullmatch(r"[0-9.]+ s\n[0-9,]+ MiB", rows[stage].measured) for stage in stages[1:])
    assert rows[stages[3]].bar == "<= 10 min for 606 groups"
    assert rows["population"].measured.splitlines()[0] == "Discovered branch groups: 6"
    assert rows["validate the release, 1 worker(s)"].measured.endswith(" s, valid")
    assert re.search(r" = [0-9.]+x$", rows["validation / (read + hash + decode)"].measured)
    assert re.match(r"D = [01]\.[0-9]{3}, p = ", rows["gate's p-values of max_t against uniform"].measured)
    assert {path: path.read_bytes() for path in source.rglob("*") if path.is_file()} == before


def test_a_build_that_fails_is_no_measurement(tmp_path: Path) -> None:
    with pytest.raises(BranchDriveError, match="is not a folder"):
        list(release.rows(tmp_path, ReleaseBench(tmp_path / "none")))
    (tmp_path / "empty").mkdir()
    with pytest.raises(BranchDriveError, match="the build ended with 1"):
        list(release.rows(tmp_path, ReleaseBench(tmp_path / "empty")))


@THOROUGH
def test_a_benchmark_is_measured_step_by_step(bare: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def run_here(command: str, *arguments: str) -> Measured:
        return Measured(0, invoke(command, *arguments), 0.1, peak_bytes(os.getpid()), 0, 0)

    monkeypatch.setattr(benchmark, "run_branchdrive", run_here)
    protocol = write_protocol(tmp_path / "protocol.json", smallest_protocol(max_epochs=1))
    rows = list(benchmark.rows(bare, jobs=1, protocol_file=protocol))
    assert [(row.what.split()[0], row.bar) for row in rows] == [
        ("train", "<= 120 s"), ("train", ""), ("predict", ""), ("evaluate:", ""), ("statistics", "<= 2 s"),
    ]  # fmt: skip
    assert all(re.match(r"[0-9.]+ s\n[0-9,]+ MiB", row.measured) for row in rows[:-1])
    assert rows[1].what == "train the 5 folds of the guard, and its risk"
    assert float(rows[-1].measured.removesuffix(" s")) > 0


def test_a_step_that_fails_is_no_measurement(bare: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benchmark, "run_branchdrive", run_in_this_process)
    (bare / ".staging").write_text("in the way")
    with pytest.raises(BranchDriveError, match="`branchdrive train` ended with 2"):
        list(benchmark.rows(bare, jobs=1))


@pytest.mark.thorough
def test_the_selector_and_plain_torch_rank_alike(bare: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("onnxruntime")
    two_of_three = model_tasks(default_protocol(), ["M3"])[:2]
    monkeypatch.setattr(ranking, "model_tasks", lambda *_: two_of_three)
    ours, theirs, difference = ranking.rows(tmp_path / "bench", release=bare, repeats=2)
    assert ours.what == "rank 13 candidates of one context, 2 seeds of M3, one thread\nexported selector"
    assert re.fullmatch(r"[0-9.]+ ms, 95 % within [0-9.]+ ms", ours.measured) and ours.bar == "<= 2 ms"
    assert re.fullmatch(r"[0-9.]+ ms, [0-9.]+x the selector's", theirs.measured)
    assert 0 <= float(difference.measured) <= float(difference.bar.removeprefix("<= "))
