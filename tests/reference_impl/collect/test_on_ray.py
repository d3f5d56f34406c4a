"""Collecting on Ray, in a folder full of hostile module names: the bytes of one process, and nothing there runs."""

from __future__ import annotations

from pathlib import Path

from tests.engines import needs_ray
from tests.hostile_folder import infest, marks, run_command
from tests.reference_impl.collect.kept_collection import identity_of

SEED, GROUPS = 3, 2


@needs_ray
def test_a_collection_has_the_bytes_of_one_process_and_runs_nothing_of_a_folder(tmp_path: Path) -> None:
    folder = tmp_path / "hostile"
    folder.mkdir()
    infest(folder, tmp_path / "marks")
    arguments = ("collect", "out", "--groups", GROUPS, "--seed", SEED, "--jobs", 2, "--executor", "ray")
    done = run_command("branchdrive", *arguments, cwd=folder, path="")
    assert done.returncode == 0, done.stderr
    assert f"identity  {identity_of(GROUPS, SEED, tmp_path)}\n" in done.stdout
    assert marks(tmp_path / "marks") == []
    assert not (folder / "kernels").exists()  # where a hostile configuration of numba wants its cache
