"""A killed writer loses nothing that was finished, shows nothing that is not, and ends with the same bytes."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.validator.writer import crashing
from tests.waiting import PATIENCE_S

from branchdrive.contract.layout import MANIFEST_FILE, STAGING_DIR

REPOSITORY = Path(__file__).parents[3]


@pytest.mark.parametrize("step", [23, pytest.param(1, marks=pytest.mark.thorough)])
def test_killed_before_any_change_of_names_it_resumes_to_the_same_bytes(tmp_path: Path, step: int) -> None:
    """Before every one of them, or before some of them."""
    command = [sys.executable, "-m", crashing.__name__, "sweep", str(tmp_path), str(step)]
    outcome = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False, cwd=REPOSITORY)
    assert outcome.returncode == 0, outcome.stderr
    sweeps = {sweep["name"]: sweep for sweep in map(json.loads, outcome.stdout.splitlines())}
    assert {name: sweep["differing"] for name, sweep in sweeps.items()} == {"collect": [], "retry": []}
    assert all(sweep["num_kills"] > 40 // step for sweep in sweeps.values())


def test_killed_at_random_moments_it_resumes_to_the_same_bytes(tmp_path: Path) -> None:
    identity = crashing.collect(tmp_path / "expected", num_groups=8)
    root = tmp_path / "killed"
    rng = random.Random(7)
    for _ in range(3):
        command = [sys.executable, "-m", crashing.__name__, "collect", str(root)]
        child = subprocess.Popen(command, stdout=subprocess.PIPE, cwd=REPOSITORY)
        assert child.stdout is not None
        child.stdout.readline()  # it has imported everything and begins
        time.sleep(rng.uniform(0, 0.25))
        os.kill(child.pid, signal.SIGKILL)
        child.communicate(timeout=PATIENCE_S)
        if root.exists():
            crashing.check_visible(root)
    assert crashing.collect(root, num_groups=8) == identity
    assert (root / MANIFEST_FILE).read_bytes() == (tmp_path / "expected" / MANIFEST_FILE).read_bytes()
    assert not (root / STAGING_DIR).exists()
