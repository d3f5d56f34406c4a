"""A collection that is killed, interrupted or asked to terminate keeps what is finished, and says how to go on."""

from __future__ import annotations

import os
import re
import signal
import time
from pathlib import Path

import pytest
from tests.reference_impl.collect.kept_collection import identity_of
from tests.reference_impl.collect.running import finished_rollouts, session_of, start, wait_for

from branchdrive.dataset.layout import DESCRIPTOR_FILE
from branchdrive_reference.collect.campaign import collect

SEED, GROUPS = 3, 2


@pytest.fixture(scope="module")
def identity(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Of the same collection, left alone."""
    return identity_of(GROUPS, SEED, tmp_path_factory.mktemp("identity"))


def test_a_killed_collection_is_resumed_at_once(tmp_path: Path, identity: str) -> None:
    root = tmp_path / "d"
    process = start(root, seed=SEED, jobs=2, groups=GROUPS)
    wait_for(lambda: finished_rollouts(root) >= 4)
    process.kill()
    process.communicate()
    report = collect(root, num_groups=GROUPS, seed=SEED)
    assert report.identity == identity
    assert sum(group.num_reused for group in report.groups) + 15 * report.num_found >= 4
    wait_for(lambda: not session_of(process.pid), timeout_s=5.0)


RESUME_LINE = r"interrupted; \d+ of \d+ groups are finished. To go on, run: branchdrive collect .*\n"
STOPS = {signal.SIGINT: 130, signal.SIGTERM: 143}

each_stop = pytest.mark.parametrize("stop", STOPS, ids=lambda stop: stop.name)


@each_stop
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_stopped_collection_keeps_what_is_finished(
    tmp_path: Path, identity: str, jobs: int, stop: signal.Signals
) -> None:
    root = tmp_path / "d"
    process = start(root, seed=SEED, jobs=jobs, groups=GROUPS)
    wait_for(lambda: finished_rollouts(root) >= 2)
    os.killpg(process.pid, stop)
    out, err = process.communicate(timeout=30)
    assert process.returncode == STOPS[stop]
    assert "identity" not in out
    assert re.fullmatch(RESUME_LINE, err)
    wait_for(lambda: not session_of(process.pid), timeout_s=5.0)
    report = collect(root, num_groups=GROUPS, seed=SEED)
    assert report.identity == identity
    assert sum(group.num_reused for group in report.groups) + 15 * report.num_found >= 2


@each_stop
@pytest.mark.parametrize("delay_s", [0.0, 0.05, 0.2, 0.5, 1.0])
def test_workers_that_begin_are_stopped_in_silence(tmp_path: Path, delay_s: float, stop: signal.Signals) -> None:
    root = tmp_path / "d"
    process = start(root, seed=SEED, jobs=2, groups=30)
    wait_for((root / DESCRIPTOR_FILE).exists)  # written right before the workers are started
    time.sleep(delay_s)
    os.killpg(process.pid, stop)
    _, err = process.communicate(timeout=60)
    assert process.returncode == STOPS[stop]
    assert re.fullmatch(RESUME_LINE, err)
    wait_for(lambda: not session_of(process.pid), timeout_s=5.0)


def test_a_second_interrupt_does_not_wait_for_the_workers(tmp_path: Path) -> None:
    root = tmp_path / "d"
    process = start(root, seed=SEED, jobs=2, groups=30)
    wait_for(lambda: len(session_of(process.pid)) >= 4)  # with both workers and the resource tracker
    for _ in range(2):
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.2)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert re.fullmatch(RESUME_LINE, err)
    wait_for(lambda: not session_of(process.pid), timeout_s=5.0)


def test_a_worker_that_dies_ends_the_collection_in_one_line(tmp_path: Path) -> None:
    root = tmp_path / "d"
    process = start(root, seed=SEED, jobs=2, groups=30)
    wait_for(lambda: finished_rollouts(root) >= 1)
    os.kill(max(session_of(process.pid)), signal.SIGKILL)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 4
    assert "a worker process died; make room in memory or use fewer `--jobs`, and run the same command again" in err
    assert err.count("\n") == 1
    wait_for(lambda: not session_of(process.pid), timeout_s=5.0)
