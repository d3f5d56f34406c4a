"""A build that meets a full disk says so, leaves nothing half-written, and goes on when there is room."""

from __future__ import annotations

import errno
import io
import os
from pathlib import Path

import pytest
from tests.synthetic_release import SEED
from tests.validator.release.running import contents

from branchdrive.cli.main import run


def test_a_build_on_a_full_disk_goes_on_when_there_is_room(
    dataset: Path, built: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["build", str(dataset), "--no-leakage", "--seed", str(SEED)]
    fsync, left = os.fsync, [0]

    def limited(descriptor: int) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", limited)
    for room in (4, 9, 30):
        left[0], stderr = room, io.StringIO()
        assert run(arguments, io.StringIO(), stderr) == 4
        assert stderr.getvalue().startswith(f"branchdrive: {dataset}")
        assert "No space left on device; make room on its disk and run the same command again" in stderr.getvalue()
        assert not [path for path in contents(dataset) if path.endswith(".partial")]
    left[0] = 10**6
    assert run(arguments, io.StringIO(), io.StringIO()) == 0
    assert contents(dataset) == contents(built)
