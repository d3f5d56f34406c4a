"""Collecting with workers, in a folder full of hostile module names: nothing there runs, and no byte changes."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from tests.hostile_folder import infest, marks, run_command
from tests.reference_impl.collect.kept_collection import identity_of

SEED, GROUPS = 3, 2


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("hostile")


@pytest.fixture(scope="module")
def done(folder: Path) -> subprocess.CompletedProcess[str]:
    """A collection by two workers."""
    infest(folder, folder / "marks")
    arguments = ("collect", "out", "--groups", GROUPS, "--seed", SEED, "--jobs", 2)
    return run_command("branchdrive", *arguments, cwd=folder, path="")


def test_workers_change_no_byte(done: subprocess.CompletedProcess[str], tmp_path: Path) -> None:
    assert (done.returncode, done.stderr) == (0, "")
    assert f"identity  {identity_of(GROUPS, SEED, tmp_path)}\n" in done.stdout


def test_collect_runs_nothing_of_a_folder(done: subprocess.CompletedProcess[str], folder: Path) -> None:
    assert done.returncode == 0
    assert marks(folder / "marks") == []
    assert not (folder / "kernels").exists()  # where a hostile configuration of numba wants its cache
