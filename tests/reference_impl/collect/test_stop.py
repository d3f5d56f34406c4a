"""A collection that is killed, interrupted or asked to terminate keeps what is finished, and says how to go on."""

from __future__ import annotations

import io
import os
import re
import signal
import time
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from tests.content_cache import remembered
from tests.reference_impl.collect.kept_collection import identity_of
from tests.reference_impl.collect.running import finished_rollouts, session_of, start
from tests.sampling import THOROUGH, sampled
from tests.waiting import PATIENCE_S, wait_for

from branchdrive.cli.main import run
from branchdrive.contract.layout import DESCRIPTOR_FILE
from branchdrive_reference.collect.campaign import collect
from branchdrive_reference.simulation import rollout

SEED, GROUPS = 3, 2

pytestmark = pytest.mark.usefixtures("remembered_runs")


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
    wait_for(lambda: not session_of(process.pid))


RESUME_LINE = r"interrupted; \d+ of \d+ groups are finished. To go on, run: branchdrive collect .*\n"
STOPS = {signal.SIGINT: 130, signal.SIGTERM: 143}


@pytest.mark.parametrize("stop", STOPS, ids=lambda stop: stop.name)
def test_a_rollout_in_which_a_stop_arrives_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, heeded_interrupts: None, identity: str, stop: signal.Signals
) -> None:
    root, number = tmp_path / "d", count(1)

    def stopped_in_the_third(*arguments: Any, **options: Any) -> rollout.Run:
        if next(number) == 3:
            signal.raise_signal(stop)
        return remembered(rollout.run)(*arguments, **options)

    arguments = ["collect", str(root), "--groups", str(GROUPS), "--seed", str(SEED)]
    with monkeypatch.context() as patch:
        patch.setattr("branchdrive_reference.collect.effect.run", stopped_in_the_third)
        stdout, stderr = io.StringIO(), io.StringIO()
        assert run(arguments, stdout, stderr) == STOPS[stop]
    assert "identity" not in stdout.getvalue()
    assert re.fullmatch(RESUME_LINE, stderr.getvalue())
    assert finished_rollouts(root) == 3
    report = collect(root, num_groups=GROUPS, seed=SEED)
    assert report.identity == identity
    assert sum(group.num_reused for group in report.groups) == 3


@THOROUGH  # the tests beside it: what is finished is kept in one process, and workers end in silence
@pytest.mark.parametrize(("jobs", "stop"), [(1, signal.SIGINT), (2, signal.SIGTERM)])
def test_a_stopped_collection_keeps_what_is_finished(
    tmp_path: Path, identity: str, jobs: int, stop: signal.Signals
) -> None:
    root = tmp_path / "d"
    process = start(root, seed=SEED, jobs=jobs, groups=GROUPS)
    wait_for(lambda: finished_rollouts(root) >= 2)
    os.killpg(process.pid, stop)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == STOPS[stop]
    assert "identity" not in out
    assert re.fullmatch(RESUME_LINE, err)
    wait_for(lambda: not session_of(process.pid))
    report = collect(root, num_groups=GROUPS, seed=SEED)
    assert report.identity == identity
    assert sum(group.num_reused for group in report.groups) + 15 * report.num_found >= 2


@pytest.mark.parametrize(
    ("delay_s", "stop"),
    sampled(
        [
            (0.0, signal.SIGINT),
            (0.05, signal.SIGTERM),
            (0.2, signal.SIGINT),
            (0.5, signal.SIGTERM),
            (1.0, signal.SIGINT),
        ],
        every=5,
    ),
)
def test_workers_that_begin_are_stopped_in_silence(tmp_path: Path, delay_s: float, stop: signal.Signals) -> None:
    root = tmp_path / "d"
    process = start(root, seed=SEED, jobs=2, groups=8)
    wait_for((root / DESCRIPTOR_FILE).exists)  # written right before the workers are started
    time.sleep(delay_s)
    os.killpg(process.pid, stop)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == STOPS[stop]
    assert re.fullmatch(RESUME_LINE, err)
    wait_for(lambda: not session_of(process.pid))


WAITING = """
import sys, time
from pathlib import Path
while any("spawn_main" in argument for argument in sys.orig_argv) and not Path({gate!r}).exists():
    time.sleep(0.02)
"""
"""A module that every interpreter loads first: it keeps workers from starting until there is a file."""


@THOROUGH
def test_further_interrupts_wait_for_no_rollout_and_leave_no_worker_behind(tmp_path: Path) -> None:
    root, gate = tmp_path / "d", tmp_path / "gate"
    (tmp_path / "sitecustomize.py").write_text(WAITING.format(gate=str(gate)))
    process = start(root, seed=SEED, jobs=2, groups=8, loaded_first=tmp_path)
    wait_for(lambda: len(session_of(process.pid)) >= 4)
    for _ in range(4):  # while workers are started
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.2)
    gate.touch()
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert re.fullmatch(RESUME_LINE, err)
    assert finished_rollouts(root) == 0
    wait_for(lambda: not session_of(process.pid))


def test_a_worker_that_dies_ends_the_collection_in_one_line(tmp_path: Path) -> None:
    root = tmp_path / "d"
    process = start(root, seed=SEED, jobs=2, groups=8)
    wait_for(lambda: finished_rollouts(root) >= 1)
    os.kill(max(session_of(process.pid)), signal.SIGKILL)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 4
    assert "a worker process died; make room in memory or use fewer `--jobs`, and run the same command again" in err
    assert err.count("\n") == 1
    wait_for(lambda: not session_of(process.pid))
