"""A collection in worker processes that is killed without notice goes on to the same content."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

from tests.repo.checkout import ROOT

from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import check_against_manifest

KILLS = """
import os, re, signal, sys

finished = []

def kill_at_the_fifth(event, arguments):
    if event == "os.rename" and re.search("/groups/0[^/]*/g[^/]*$", str(arguments[1])):
        finished.append(arguments[1])
        if len(finished) == 5:
            os.kill(os.getppid(), signal.SIGKILL)
            os.kill(os.getpid(), signal.SIGKILL)

if any("spawn_main" in argument for argument in sys.orig_argv):
    sys.addaudithook(kill_at_the_fifth)
"""
"""A module that every interpreter loads first: a worker kills the collector, and itself, before its fifth rollout."""


def command(root: Path, jobs: int = 1) -> list[str]:
    collector = str(ROOT / "docs/examples/minimal_collector.py")
    return [sys.executable, collector, str(root), "--groups", "2", "--jobs", str(jobs)]


def num_finished(root: Path) -> int:
    return sum(not path.name.startswith(".") for path in (root / ".staging" / "groups").glob("0*/g*"))


def test_killed_in_the_middle_it_resumes_to_the_same_content(tmp_path: Path) -> None:
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    subprocess.run(command(whole), check=True, capture_output=True)
    (tmp_path / "sitecustomize.py").write_text(KILLS)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    child = subprocess.run(command(killed, jobs=2), capture_output=True, env=environment)
    assert child.returncode == -signal.SIGKILL
    assert 4 <= num_finished(killed) < 30
    resumed = subprocess.run(command(killed), check=True, capture_output=True, text=True)
    assert "0 found finished" in resumed.stdout
    assert check_against_manifest(Folder(killed)).identity == check_against_manifest(Folder(whole)).identity
