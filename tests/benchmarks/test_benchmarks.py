"""The benchmarks measure something, and say what they lack."""

from __future__ import annotations

import io
import os
import re
import resource
import subprocess
import sys
import tarfile
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.cost import Cost, cost_of
from benchmarks.floor import read_folder
from benchmarks.memory import Measured, peak_bytes, process_tree, reset_peak, run_measured
from benchmarks.release import ReleaseBench
from benchmarks.row import Row
from benchmarks.simulator import measure_ticks_per_s
from tests.content_cache import kept_folder
from tests.reference_impl.benchmark.small_release import invoke, make_release, smallest_protocol, write_protocol
from tests.reference_impl.collect.kept_collection import kept_collection
from tests.sampling import THOROUGH, sampled

from benchmarks import __main__ as bench
from benchmarks import benchmark, highway_env, paper, places, ranking, release, validation
from branchdrive.benchmark.protocol.protocol import default_protocol
from branchdrive.cli.main import run
from branchdrive.errors import BranchDriveError, DecodeError
from branchdrive.release.builder import build_release
from branchdrive.runtime.environment import install_command
from branchdrive.runtime.executor import isolated
from branchdrive.runtime.process import child_environment, python_command
from branchdrive_reference.benchmark.training import model_tasks
from branchdrive_reference.rendering.encoding import encoded

MIB = 2**20
COST = r"-?[0-9.]+ s \(-?[0-9.]+ CPU-s\)"
RATIO = rf"-?[0-9.]+x \(-?[0-9.]+x CPU\)\nvalidation {COST}\nfloor {COST}"
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


def test_the_cost_of_an_action_counts_the_processes_it_starts() -> None:
    outcomes: list[tuple[int, Any]] = []
    cost = cost_of(lambda: outcomes.extend(isolated(1)(spend_cpu, [3_000_000])))
    [(_, spent_s)] = outcomes
    assert cost.cpu_s >= spent_s > 0
    assert cost.wall_s > 0
    assert str(Cost(1.0, 2.0) - Cost(0.5, 0.5)) == "0.50 s (1.50 CPU-s)"
    assert Cost(3.0, 2.0).over(Cost(2.0, 4.0)) == "1.50x (0.50x CPU)"


def spend_cpu(num_terms: int) -> float:
    """Seconds of this process after some work."""
    assert sum(range(num_terms)) > 0
    return resource.getrusage(resource.RUSAGE_SELF).ru_utime


def test_workers_of_the_floor_and_of_the_peak_import_the_core_alone() -> None:
    code = "import sys, benchmarks.floor, benchmarks.worker_peak; print(*{name.split('.')[0] for name in sys.modules})"
    done = subprocess.run(
        python_command("-c", code), env=child_environment(), capture_output=True, text=True, check=True
    )
    assert "branchdrive" in done.stdout.split()
    assert not {"branchdrive_reference", "branchdrive_conformance", "numba", "pymunk", "torch"} & {*done.stdout.split()}


def test_the_floor_decodes_the_images_of_an_archive(tmp_path: Path) -> None:
    for content, outcome in (
        (encoded(np.zeros((8, 8, 3), np.uint8)), nullcontext()),
        (b"no image", pytest.raises(DecodeError)),
    ):
        with tarfile.open(tmp_path / "media.tar", "w") as archive:
            member = tarfile.TarInfo("image")
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
        with outcome:
            assert read_folder(tmp_path) == 0


@pytest.mark.thorough
def test_validation_is_measured_with_its_start_up_growth_memory_and_layers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built = kept_collection(tmp_path / "built", num_groups=6, seed=1)
    build_release(built)
    monkeypatch.setattr(validation, "_benchmarked", lambda _, release: release)  # six groups are none to train on
    for name, value in (
        ("_COLLECTED_GROUPS", 1),
        ("_GROUPS_PER_SHARD", 1),
        ("_PEAK_GROUPS", (1, 2)),
        ("_FILMED_GROUPS", 1),
    ):
        monkeypatch.setattr(validation, name, value)
    rows = list(validation.rows(tmp_path / "bench", num_groups=4, release=built, repeats=1))
    bars = {row.what: row.bar for row in rows}
    over = "over read + hash + decode"
    assert bars == {
        "start-up, 1 worker": "",
        f"raw layer, 4 groups, 1 worker\ngross, {over}": "<= 2.2x",
        f"raw layer, 4 groups, 1 worker\nnet of start-up, {over}": "<= 4x",
        "start-up, 2 workers": "",
        f"raw layer, 4 groups, 2 workers\ngross, {over}": "<= 1.6x",
        f"raw layer, 4 groups, 2 workers\nnet of start-up, {over}": "",
        "two workers over one, gross": ">= 1.8x",
        "growth over 1, 2, 4 groups, 1 worker\nnet CPU time for each group": "<= 1.1",
        f"SQL checker, raw layer, 1 groups\n{rows[8].what.splitlines()[1]}": "",
        "worker's peak, shards of 1, 2 groups": "",
        "worker's peak for each group of a shard": "<= 3 MiB",
        **{
            f"{what}{name}, {over}": bar if name != ", 1 worker\ngross" else ""
            for what, bar in (
                ("raw layer with images, all decoded", "<= 1.7x"),
                ("release", "<= 6x"),
                ("release with a benchmark", "<= 8x"),
            )
            for name in (", 1 worker\ngross", "\nin a warm worker")
        },
    }
    assert all(re.fullmatch(RATIO, row.measured) for row in rows if over in row.what)


def test_figures_are_printed_as_they_are(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [Row("workers", "pip install '.[ray]'", "[1]")]
    monkeypatch.setattr(bench, "_measurements", lambda *_: {"a [red] part": iter(rows)})
    monkeypatch.setattr(sys, "argv", ["benchmarks"])
    bench.main()
    said = capsys.readouterr().out
    assert all(text in said for text in ("a [red] part", "pip install '.[ray]'", "[1]"))


@THOROUGH
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
    (ratio,) = (row.measured for what, row in rows.items() if re.fullmatch(r"release, 1 worker\(s\)", what))
    assert re.fullmatch(RATIO, ratio)
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
        ("train", "<= 120 s"), ("train", ""), ("predict", ""), ("evaluate:", ""),
        ("all", "<= 240 s for 1,000 groups"), ("statistics", "<= 2 s"),
    ]  # fmt: skip
    assert all(
        re.match(r"[0-9.]+ s\n[0-9,]+ MiB", row.measured) for row in rows if row.what.startswith(("tr", "p", "e"))
    )
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
    assert re.fullmatch(r"[0-9.]+ ms, 95 % within [0-9.]+ ms", ours.measured) and ours.bar == "<= 2.5 ms"
    assert re.fullmatch(r"[0-9.]+ ms, [0-9.]+x the selector's", theirs.measured)
    assert 0 <= float(difference.measured) <= float(difference.bar.removeprefix("<= "))


@THOROUGH
def test_places_cache_and_ray_are_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(places, "find_spec", lambda _: None)
    folder, bucket, taken, changed, on_ray = places.rows(tmp_path, num_shards=2, repeats=1)
    assert re.fullmatch(COST, folder.measured)
    assert (bucket.bar, changed.bar, on_ray.bar) == ("<= 1.5x CPU", "<= 5 %", "<= 1.2x")
    assert re.fullmatch(r"[0-9.]+x \([0-9.]+x CPU\)\n[0-9.]+", bucket.measured)
    assert float(bucket.measured.splitlines()[1]) < 10  # requests a shard: tables, and documents of the whole
    assert all(re.fullmatch(r"[0-9.]+ %", row.measured) for row in (taken, changed))
    assert "pip install" in on_ray.measured
