"""A collection in worker processes that is killed without notice goes on to the same content."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from tests.repo.checkout import ROOT

from branchdrive.formats.manifest import check_against_manifest

DEADLINE_S = 300.0


def command(root: Path, jobs: int = 1) -> list[str]:
    collector = str(ROOT / "docs/examples/minimal_collector.py")
    return [sys.executable, collector, str(root), "--groups", "2", "--jobs", str(jobs)]


def num_finished(root: Path) -> int:
    return sum(not path.name.startswith(".") for path in (root / ".staging" / "groups").glob("0*/g*"))


def test_killed_in_the_middle_it_resumes_to_the_same_content(tmp_path: Path) -> None:
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    subprocess.run(command(whole), check=True, capture_output=True)
    child = subprocess.Popen(command(killed, jobs=2), stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    deadline_s = time.monotonic() + DEADLINE_S
    while num_finished(killed) < 5 and time.monotonic() < deadline_s:
        time.sleep(0.02)
    os.kill(child.pid, signal.SIGKILL)
    child.communicate()
    assert 5 <= num_finished(killed) < 30
    resumed = subprocess.run(command(killed), check=True, capture_output=True, text=True)
    assert "0 found finished" in resumed.stdout
    assert check_against_manifest(killed).identity == check_against_manifest(whole).identity
