"""Rendering on Ray, killed and gone on with in a folder full of hostile module names: the bytes of one process."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

from tests.engines import needs_ray
from tests.hostile_folder import infest, marks, run_command
from tests.places import files_of
from tests.synthetic import with_few_attempts, write_dataset
from tests.synthetic_map import map_descriptor, map_tables
from tests.waiting import wait_for

from branchdrive_reference.rendering.dataset import render_dataset
from branchdrive_reference.rendering.plan import MediaPlan
from branchdrive_reference.rendering.rig import cameras_of

OPTIONS = ("--streams", "rgb_top_down", "--width", "16", "--height", "16", "--jobs", "1", "--executor", "ray")


def kill_after_a_group(*words: str, cwd: Path) -> None:
    """Start a command on Ray, and kill it as soon as a group is rendered."""
    command = [str(Path(sys.executable).with_name("branchdrive")), *words]
    with subprocess.Popen(command, cwd=cwd, stderr=subprocess.PIPE, start_new_session=True) as driver:
        wait_for(lambda: driver.poll() is not None or any(cwd.glob("*/.staging/render/frames/*/*.parquet")))
        assert driver.poll() is None, driver.communicate()
        os.kill(driver.pid, signal.SIGKILL)


@needs_ray
def test_media_have_the_bytes_of_one_process_and_nothing_of_a_folder_runs(tmp_path: Path) -> None:
    folder, bare = tmp_path / "hostile", tmp_path / "bare"
    write_dataset(bare, with_few_attempts(map_tables()), map_descriptor())
    folder.mkdir()
    infest(folder, tmp_path / "marks")
    shutil.copytree(bare, folder / "dataset")
    kill_after_a_group("render", "dataset", *OPTIONS, cwd=folder)
    assert files_of(folder / "dataset").keys() >= files_of(bare).keys(), "it stays as it is until all is rendered"
    done = run_command("branchdrive", "render", "dataset", *OPTIONS, cwd=folder, path="")
    assert done.returncode == 0, done.stderr
    assert "0 found rendered" not in done.stdout
    render_dataset(bare, MediaPlan(cameras_of(("rgb_top_down",), width_px=16, height_px=16)))
    assert files_of(folder / "dataset") == files_of(bare)
    assert marks(tmp_path / "marks") == []
