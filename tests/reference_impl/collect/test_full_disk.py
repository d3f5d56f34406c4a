"""A collection that meets a full disk says so, and goes on when there is room, without loss."""

from __future__ import annotations

import errno
import io
import os
from pathlib import Path

import pytest
from tests.reference_impl.collect.running import finished_rollouts

from branchdrive.cli.main import run
from branchdrive_reference.collect.campaign import collect


@pytest.mark.usefixtures("remembered_runs")
def test_a_collection_on_a_full_disk_goes_on_when_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, fsync, left = tmp_path / "out", os.fsync, [40]

    def limited(descriptor: int) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(descriptor)

    arguments = ["collect", str(root), "--groups", "1", "--seed", "1"]
    with monkeypatch.context() as context:
        context.setattr(os, "fsync", limited)
        stderr = io.StringIO()
        assert run(arguments, io.StringIO(), stderr) == 4
    assert stderr.getvalue().startswith(f"branchdrive: {root}/.staging/")
    assert "No space left on device; make room on its disk and run the same command again" in stderr.getvalue()
    kept, stdout = finished_rollouts(root), io.StringIO()
    assert kept > 0
    assert run(arguments, stdout, io.StringIO()) == 0
    assert f", {kept} found finished" in stdout.getvalue()
    assert collect(tmp_path / "again", num_groups=1, seed=1).identity in stdout.getvalue()
