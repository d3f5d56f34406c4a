"""Collecting in a folder full of hostile module names: nothing there runs, and nothing changes."""

from __future__ import annotations

from pathlib import Path

from tests.hostile_folder import infest, marks, run_command
from tests.reference_impl.collect.kept_collection import identity_of


def test_collect_runs_nothing_of_a_folder(tmp_path: Path) -> None:
    infest(tmp_path, tmp_path / "marks")
    done = run_command("branchdrive", "collect", "out", "--groups", 2, "--seed", 3, "--jobs", 2, cwd=tmp_path, path="")
    assert (done.returncode, done.stderr) == (0, "")
    assert f"identity  {identity_of(2, 3, tmp_path / 'here')}\n" in done.stdout
    assert marks(tmp_path / "marks") == []
    assert not (tmp_path / "kernels").exists()  # where a hostile configuration of numba wants its cache
