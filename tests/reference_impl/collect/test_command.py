"""`branchdrive collect`: datasets are valid, independent of workers, and survive interruptions."""

from __future__ import annotations

import io
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from branchdrive import validate
from branchdrive.cli.main import run
from branchdrive_reference.collect.campaign import collect

SEED, GROUPS = 3, 3


def branchdrive(*arguments: object) -> tuple[int, str, str]:
    stdout, stderr = io.StringIO(), io.StringIO()
    return run([str(argument) for argument in arguments], stdout, stderr), stdout.getvalue(), stderr.getvalue()


def heed_interrupts() -> None:
    """Undo what a background shell does to its children: they ignore interrupts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def start(root: Path, *, jobs: int, groups: int) -> subprocess.Popen[str]:
    arguments = ["collect", root, "--groups", groups, "--seed", SEED, "--jobs", jobs]
    return subprocess.Popen(
        [sys.executable, "-m", "branchdrive.cli", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=heed_interrupts,
    )


def wait_for(condition: Callable[[], bool], timeout_s: float = 60.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def finished_rollouts(root: Path) -> int:
    return len([path for path in root.glob(".staging/groups/*/*") if not path.name.startswith(".")])


def session_of(pid: int) -> list[int]:
    """Living processes of a session, by `/proc`."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, session = path.read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue
        if int(session) == pid and state != "Z":
            found.append(int(path.parent.name))
    return found


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    root = tmp_path_factory.mktemp("collected") / "dataset"
    return root, collect(root, num_groups=GROUPS, seed=SEED).identity


def test_a_collected_dataset_is_valid_and_every_group_qualifies(reference: tuple[Path, str]) -> None:
    report = validate(reference[0], require_groups=GROUPS)
    assert report.verdict == "valid"
    assert report.exit_code == 0
    assert report.funnel is not None
    assert report.funnel.qualified == GROUPS


def test_workers_change_no_byte(tmp_path: Path, reference: tuple[Path, str]) -> None:
    code, out, err = branchdrive("collect", tmp_path / "d", "--groups", GROUPS, "--seed", SEED, "--jobs", 2)
    assert (code, err) == (0, "")
    assert f"identity  {reference[1]}" in out


def test_a_finished_dataset_is_left_as_it_is(reference: tuple[Path, str]) -> None:
    root, identity = reference
    code, out, _ = branchdrive("collect", root, "--groups", GROUPS, "--seed", SEED)
    assert code == 0
    assert f"groups    0 collected, {GROUPS} found finished" in out
    assert identity in out


def test_a_finished_dataset_does_not_grow(reference: tuple[Path, str]) -> None:
    root, identity = reference
    code, out, err = branchdrive("collect", root, "--groups", GROUPS + 2, "--seed", SEED)
    assert (code, out) == (2, "")
    assert f"is a finished dataset of {GROUPS} groups, which stays as it is; choose another folder" in err
    assert collect(root, num_groups=GROUPS, seed=SEED).identity == identity


def test_the_summary_reads_well(tmp_path: Path) -> None:
    _, out, _ = branchdrive("collect", tmp_path / "d", "--groups", 1, "--seed", SEED)
    assert re.fullmatch(
        r"groups    1 collected, 0 found finished\n"
        r"rollouts  15 simulated, 0 found finished\n"
        r"ticks     [\d,]+ in [\d.]+ s with 1 job, writing included: [\d,]+ ticks/s\n"
        r"dataset   \S+\n"
        r"identity  [0-9a-f]{64}\n"
        r"next      branchdrive-validate \S+\n",
        out,
    )


def test_a_killed_collection_is_resumed_at_once(tmp_path: Path, reference: tuple[Path, str]) -> None:
    root = tmp_path / "d"
    process = start(root, jobs=2, groups=GROUPS)
    wait_for(lambda: finished_rollouts(root) >= 4)
    process.kill()
    process.communicate()
    report = collect(root, num_groups=GROUPS, seed=SEED)
    assert report.identity == reference[1]
    assert sum(group.num_reused for group in report.groups) + 15 * report.num_found >= 4
    wait_for(lambda: not session_of(process.pid), timeout_s=5.0)


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_interrupt_keeps_what_is_finished(tmp_path: Path, reference: tuple[Path, str], jobs: int) -> None:
    root = tmp_path / "d"
    process = start(root, jobs=jobs, groups=GROUPS)
    wait_for(lambda: finished_rollouts(root) >= 2)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert re.fullmatch(r"interrupted; \d of 3 groups are finished. To go on, run: branchdrive collect .*\n", err)
    assert collect(root, num_groups=GROUPS, seed=SEED).identity == reference[1]


@pytest.mark.parametrize(
    "arguments",
    [
        ["--groups", 0, "--seed", 1],
        ["--groups", 1, "--seed", -1],
        ["--groups", 1, "--seed", 1, "--jobs", 0],
        ["--groups", 1],
        ["--groups", 1_000_001, "--seed", 1],
        ["--groups", "many", "--seed", 1],
        ["--groups", 1, "--seed", "x"],
    ],
    ids=["no groups", "negative seed", "no jobs", "no seed", "too many groups", "no number", "no number for a seed"],
)
def test_wrong_usage_exits_with_2(tmp_path: Path, arguments: list[object], capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = branchdrive("collect", tmp_path / "d", *arguments)
    captured = capsys.readouterr()
    assert code == 2
    assert not (tmp_path / "d").exists()
    assert not re.search(r"\b_(count|seed)\b", out + err + captured.out + captured.err)


def test_a_folder_of_another_dataset_is_refused(reference: tuple[Path, str]) -> None:
    code, out, err = branchdrive("collect", reference[0], "--groups", 1, "--seed", SEED + 1)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert f"another descriptor (dataset_id is 'branchdrive-reference-s{SEED}', not " in err
    assert f"collection.seed is {SEED}, not {SEED + 1}" in err
