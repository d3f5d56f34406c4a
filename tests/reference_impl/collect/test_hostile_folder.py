"""Collecting with workers, in a folder full of hostile module names: nothing there runs, and no byte changes."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.hostile_folder import infest, marks, run_command
from tests.reference_impl.collect.kept_collection import identity_of

from branchdrive.errors import PlatformError
from branchdrive.runtime.executor import in_process, isolated
from branchdrive_reference.collect.campaign import collect

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
    assert done.returncode == 0
    assert all(line.startswith("collecting groups") for line in done.stderr.splitlines())  # one a minute
    assert f"identity  {identity_of(GROUPS, SEED, tmp_path)}\n" in done.stdout


def test_collect_runs_nothing_of_a_folder(done: subprocess.CompletedProcess[str], folder: Path) -> None:
    assert done.returncode == 0
    assert marks(folder / "marks") == []
    assert not (folder / "kernels").exists()  # where a hostile configuration of numba wants its cache


def test_an_executor_changes_no_byte(tmp_path: Path) -> None:
    expected = identity_of(GROUPS, SEED, tmp_path)
    assert collect(tmp_path / "out", num_groups=GROUPS, seed=SEED, executor=isolated(2)).identity == expected


def test_groups_that_are_collected_where_nobody_sees_them_are_told_of(tmp_path: Path) -> None:
    other = tmp_path / "other"

    def elsewhere(function: Any, tasks: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
        """A machine whose folder has the same name and is another."""
        shutil.copytree(tasks[0].function.root, other)
        yield from in_process(function, [replace(task, function=replace(task.function, root=other)) for task in tasks])

    with pytest.raises(PlatformError, match=r"group 'g[^']*' was finished on another machine"):
        collect(tmp_path / "out", num_groups=1, seed=SEED, executor=elsewhere)
