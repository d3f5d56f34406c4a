"""Executors: the same results everywhere, and processes that die take nothing else with them."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import pytest
from benchmarks.memory import process_tree
from tests import synthetic
from tests.repo.checkout import ROOT
from tests.sampling import sampled
from tests.validator.engine.datasets import DEPARTURES, cells, write, write_with
from tests.validator.runtime.tasks import (
    allocate,
    broken_import,
    converts_with_pandas,
    die_at_file,
    die_at_rules,
    die_on_three,
    die_once,
    double,
    exhaust_memory_on_three,
    interrupt,
    leave_quietly,
    own_process,
    raise_on_three,
    started_by,
)
from tests.waiting import PATIENCE_S, wait_for

from branchdrive.engine.validate import validate
from branchdrive.errors import PlatformError
from branchdrive.runtime.executor import Died, Executor, Failed, in_process, isolated, load_soon
from branchdrive.runtime.standing import standing


def results(executor: Executor, function: Callable[[Any], Any], tasks: list[Any]) -> dict[int, Any]:
    found = list(executor(function, tasks))
    assert len({index for index, _ in found}) == len(found)
    return dict(found)


EXECUTORS = {"in process": in_process, "one worker": isolated(1), "two workers": isolated(2)}
each_executor = pytest.mark.parametrize("executor", sampled(EXECUTORS.values(), every=2), ids=EXECUTORS)
each_isolated = pytest.mark.parametrize(
    "executor", sampled([isolated(2), isolated(1)], every=2), ids=["two workers", "one worker"]
)


@each_executor
def test_every_task_gives_its_result(executor: Executor) -> None:
    assert results(executor, double, list(range(7))) == {i: 2 * i for i in range(7)}
    assert results(executor, double, []) == {}


@each_executor
def test_an_exception_is_a_failure_of_its_task_alone(executor: Executor) -> None:
    found = results(executor, raise_on_three, list(range(5)))
    failure = found.pop(3)
    assert found == {0: 0, 1: 2, 2: 4, 4: 8}
    assert isinstance(failure, Failed)
    assert "ValueError: three\\x1b[31m" in failure.message


@each_executor
def test_running_out_of_memory_is_a_death_of_its_task_alone(executor: Executor) -> None:
    found = results(executor, exhaust_memory_on_three, list(range(5)))
    assert found == {0: 0, 1: 2, 2: 4, 3: Died(), 4: 8}


@each_isolated
def test_a_process_that_dies_twice_is_reported_and_affects_no_other_task(executor: Executor) -> None:
    assert results(executor, die_on_three, list(range(6))) == {0: 0, 1: 2, 2: 4, 3: Died(), 4: 8, 5: 10}


@each_isolated
def test_a_process_that_dies_once_is_tried_again(executor: Executor, tmp_path: Path) -> None:
    tasks = [(str(tmp_path), value) for value in range(6)]
    assert results(executor, die_once, tasks) == {i: 2 * i for i in range(6)}
    assert (tmp_path / "3").exists()


def test_a_module_that_workers_cannot_import_is_no_death(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BROKEN_IMPORT", "1")
    with pytest.raises(PlatformError, match="a worker process cannot be loaded: libarrow"):
        results(isolated(2), broken_import, [1, 2])


def test_workers_do_without_pandas() -> None:
    assert results(isolated(1), converts_with_pandas, [1]) == {0: False}


def test_every_task_may_die() -> None:
    assert results(isolated(2), leave_quietly, [1, 2, 3]) == {0: Died(), 1: Died(), 2: Died()}


def test_workers_have_a_memory_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("branchdrive.runtime.executor.spec_limits", lambda: _Limits())
    found = results(isolated(1), allocate, [1 << 20, 1 << 32, 1 << 21])
    assert found == {0: 1 << 20, 1: Died(), 2: 1 << 21}


class _Limits:
    max_worker_bytes = 1 << 30


class Fragile(ThreadPoolExecutor):
    """A pool that is found broken at every second task."""

    num_submitted = 0

    def __init__(self, jobs: int, _: object) -> None:
        super().__init__(jobs)

    def submit(self, *arguments: Any) -> Any:  # type: ignore[override]
        Fragile.num_submitted += 1
        if Fragile.num_submitted % 2 == 0:
            raise BrokenProcessPool
        return super().submit(*arguments)


def test_a_pool_that_breaks_between_two_tasks_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("branchdrive.runtime.executor._pool", Fragile)
    assert results(isolated(2), double, list(range(5))) == {i: 2 * i for i in range(5)}


def test_an_interrupt_is_not_swallowed() -> None:
    with pytest.raises(KeyboardInterrupt):
        list(in_process(interrupt, [1]))


def test_processes_that_cannot_start_are_no_fault_of_the_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("branchdrive.runtime.executor._prepare_process", die_on_three)
    monkeypatch.setattr("branchdrive.runtime.executor.spec_limits", lambda: _Deadly())
    report = validate(write(tmp_path / "dataset"), executor=isolated(1))
    assert (report.verdict, report.exit_code) == ("error", 4)
    assert "worker processes die before they take up work" in report.errors[0]


class _Deadly:
    max_worker_bytes = 3


# --- validations


SITUATIONS: dict[str, Callable[[Path], Path]] = {
    **{name: lambda root, d=departure: write(root, d.tables()) for name, departure in DEPARTURES.items()},
    "unusable descriptor": lambda root: write_with(root, {"branchdrive.json": b"[]"}),
    "undecodable table": lambda root: write_with(root, {"raw/shard-00001/actors.parquet": b"PAR1"}),
    "no shards": lambda root: write(root, {}),
}


def report_bytes(root: Path, executor: Executor) -> str:
    return json.dumps(validate(root, executor=executor).to_json(), sort_keys=True)


def validate_all(roots: list[Path]) -> list[str]:
    return [report_bytes(root, in_process) for root in roots]


def test_reports_do_not_depend_on_the_executor(tmp_path: Path) -> None:
    # Every number of workers and every situation once; what a worker says of one shard hangs on no other.
    for name, jobs in (("speed out of range", 2), ("undecodable table", 1)):
        root = SITUATIONS[name](tmp_path / name)
        assert report_bytes(root, isolated(jobs)) == report_bytes(root, in_process)


@pytest.mark.parametrize("every", sampled([3, 1], every=2))
def test_reports_do_not_depend_on_the_process(tmp_path: Path, every: int) -> None:
    # The same situations, one of so many of them, in one other process.
    roots = [SITUATIONS[name](tmp_path / name) for name in list(SITUATIONS)[::every]]
    ((_, there),) = isolated(1)(validate_all, [roots])
    assert there == validate_all(roots)


def test_a_file_that_kills_its_worker_is_a_finding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = write(tmp_path / "dataset", cells("observations", "speed_mps", {3: 1000.0}))
    monkeypatch.setattr("branchdrive.engine.reading._read", die_at_file)
    report = validate(root, executor=isolated(1))
    assert (report.verdict, report.errors) == ("invalid", ())
    found = {(finding.rule, finding.location.get("file")) for finding in report.findings}
    assert ("BD-LAY-007", "raw/shard-00001/actors.parquet") in found
    assert {rule for rule, _ in found} == {"BD-LAY-007", "BD-VAL-002"}
    assert report.dataset.num_groups == 2


def test_a_worker_that_dies_for_no_reason_in_the_data_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = write(tmp_path / "dataset", synthetic.bare_tables(), synthetic.bare_descriptor())
    monkeypatch.setattr("branchdrive.engine.reading._read", die_at_rules)
    report = validate(root, executor=isolated(1))
    assert (report.verdict, report.exit_code) == ("error", 4)
    assert report.errors == ("raw/shard-00001: the worker died twice although every file decodes on its own",)
    assert report.dataset.num_groups == len(synthetic.SHARDS["raw/shard-00000"])
    assert report.findings == ()


def test_workers_and_their_server_end_with_a_parent_that_was_killed(tmp_path: Path) -> None:
    place = tmp_path / "worker"
    code = (
        f"from branchdrive.runtime.executor import isolated\nfrom tests.validator.runtime.tasks import sleep_and_tell\n"
        f"list(isolated(1)(sleep_and_tell, [{str(place)!r}]))"
    )
    with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT) as parent:
        wait_for(lambda: place.exists() and place.read_text() != "")
        processes = process_tree(parent.pid)
        assert {parent.pid, int(place.read_text())} < processes
        parent.kill()
    wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in processes))


def test_a_death_under_a_low_limit_of_the_machine_is_no_fault_of_a_task(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("branchdrive.runtime.executor._allowed_bytes", lambda: 1.5 * 2**30)
    with pytest.raises(PlatformError, match=r"no more than 1\.5 GiB of memory here.*raise `ulimit -v`"):
        results(isolated(1), leave_quietly, [1])


@pytest.mark.skipif(sys.platform != "linux", reason="forked on Linux alone")
def test_calls_of_one_executor_share_the_process_that_forks_their_workers() -> None:
    executor = isolated(2)
    found = {outcome for _ in range(2) for _, outcome in executor(started_by, [0, 1])}
    assert len(found) == 1
    assert found != {os.getpid()}
    assert pickle.loads(pickle.dumps(executor)) == executor


@pytest.mark.skipif(sys.platform != "linux", reason="forked on Linux alone")
def test_what_workers_need_is_loaded_before_they_are_asked_for() -> None:
    executor = load_soon(isolated(1), "branchdrive.engine.reading")
    children = process_tree(os.getpid())
    assert results(executor, started_by, [0])[0] in children
    assert load_soon(in_process, "branchdrive.engine.reading") is in_process


def test_a_script_from_standard_input_has_workers() -> None:
    code = """
from branchdrive.runtime.executor import isolated
from tests.validator.runtime.tasks import double
print(sorted(isolated(2)(double, [1, 2])))
"""
    done = subprocess.run(
        [sys.executable, "-"], input=code, cwd=ROOT, capture_output=True, text=True, check=False, timeout=PATIENCE_S
    )
    assert (done.stdout, done.stderr) == ("[(0, 2), (1, 4)]\n", "")


def test_standing_processes_stay_from_call_to_call_and_end_with_the_block() -> None:
    with standing(2) as executor:
        first = {pid for _ in range(3) for pid in results(executor, own_process, [*range(6)]).values()}
        assert len(first) <= 2
        assert os.getpid() not in first
        found = results(executor, die_on_three, [*range(5)])
        assert found == {0: 0, 1: 2, 2: 4, 3: Died(), 4: 8}
        found = results(executor, raise_on_three, [3])
        assert isinstance(found[0], Failed)
        assert found[0].reason == "second line"
        last = {*results(executor, own_process, [*range(6)]).values()}
    for process in first | last:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)
