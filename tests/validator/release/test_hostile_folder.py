"""Builds in a folder full of hostile module names: nothing there runs, and nothing changes."""

from __future__ import annotations

import shutil
from pathlib import Path

from tests.hostile_folder import infest, marks, run_command
from tests.synthetic_release import SEED
from tests.validator.release.running import contents


def test_build_runs_nothing_of_a_folder(raw: Path, built: Path, tmp_path: Path) -> None:
    infest(tmp_path, tmp_path / "marks")
    shutil.copytree(raw, tmp_path / "release")
    done = run_command(
        "branchdrive", "build", "release", "--no-leakage", "--seed", SEED, "--jobs", 2, cwd=tmp_path, path=""
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert contents(tmp_path / "release") == contents(built)
    assert marks(tmp_path / "marks") == []
