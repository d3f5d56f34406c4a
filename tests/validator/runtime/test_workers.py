"""One function over many tasks: the same results in any process, and nobody left behind."""

from __future__ import annotations

import os
import subprocess
import sys
import traceback
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from tests.repo.checkout import ROOT
from tests.validator.runtime.tasks import Adding, count_parts, die_between, raise_between

from branchdrive.runtime.workers import WorkerError, num_workers, run_each


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_task_gives_its_result_and_reports_meanwhile(jobs: int) -> None:
    reports: list[tuple[int, int]] = []

    def watch(task: int, part: int) -> None:
        reports.append((task, part))

    found = list(run_each(Adding(3), range(5), jobs=jobs, watch=watch))
    assert sorted(found) == [3, 4, 5, 6, 7]
    assert sorted(reports) == [(task, part) for task in range(5) for part in range(2)]
    assert list(run_each(Adding(3), [], jobs=jobs)) == []


def test_one_task_takes_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr("branchdrive.runtime.workers._in_workers")
    assert list(run_each(lambda task, between: os.getpid(), ["one"], jobs=4)) == [os.getpid()]
    assert (num_workers(1, jobs=4), num_workers(0, jobs=4), num_workers(9, jobs=4)) == (1, 1, 4)


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_exception_of_a_task_is_raised_with_its_traceback(jobs: int) -> None:
    with pytest.raises(LookupError, match="no seed 1") as caught:
        list(run_each(raise_between, [1, 1, 1], jobs=jobs))
    assert "in raise_between" in "".join(traceback.format_exception(caught.value))


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_of_who_watches_stops_the_work(jobs: int) -> None:
    def stop(part: int) -> None:
        if part == 2:
            raise RuntimeError("stopped at 2")

    with pytest.raises(RuntimeError, match="stopped at 2"):
        list(run_each(count_parts, [0, 0], jobs=jobs, watch=stop))


@pytest.mark.parametrize("watch", [print, None], ids=["watched", "unwatched"])
def test_a_worker_that_dies_ends_the_work(watch: Callable[..., None] | None) -> None:
    with pytest.raises(WorkerError, match="a worker process died; make room in memory or use fewer `--jobs`"):
        list(run_each(die_between, [1, 2, 3], jobs=2, **({"watch": watch} if watch else {})))


def test_closing_stops_workers_where_they_may_stop() -> None:
    with closing(run_each(count_parts, [1, 0, 0], jobs=2)) as results:
        assert next(results) == 1


def test_a_run_that_is_closed_or_broken_leaks_no_semaphore(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "from branchdrive.runtime.workers import WorkerError, run_each\n"
        "from tests.validator.runtime.tasks import die_between, count_parts\n"
        "if __name__ == '__main__':\n"
        "    results = run_each(count_parts, [1, 0, 0], jobs=2, watch=print)\n"
        "    next(results)\n"
        "    results.close()\n"
        "    try:\n"
        "        list(run_each(die_between, [1, 2, 3], jobs=2))\n"
        "    except WorkerError:\n"
        "        print('broken')\n"
    )
    done = subprocess.run(
        [sys.executable, str(script)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.endswith("broken\n")
    assert done.stderr == ""
