"""A full disk and a limit on files: one line says so, nothing half-written stays, and the work goes on with room."""

from __future__ import annotations

import errno
import io
import os
import tempfile
from pathlib import Path

import pytest
from tests.file_size import at_most
from tests.synthetic_release import SEED
from tests.validator.release.running import contents

from branchdrive.cli.main import run
from branchdrive.engine.validate import validate
from branchdrive.errors import PlatformError


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


def test_a_build_under_a_limit_on_files_goes_on_without_it(
    dataset: Path, built: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()  # what is remembered is kept in files, too
    arguments, stderr = ["build", str(dataset), "--no-leakage", "--seed", str(SEED)], io.StringIO()
    with at_most(5_000):
        assert run(arguments, io.StringIO(), stderr) == 4
    assert stderr.getvalue().startswith("branchdrive: /")
    assert "File too large; " in stderr.getvalue()
    assert stderr.getvalue().count("\n") == 1
    assert not [path for path in contents(dataset) if path.endswith(".partial")]
    assert run(arguments, io.StringIO(), io.StringIO()) == 0
    assert contents(dataset) == contents(built)


def test_a_validation_whose_temporary_files_do_not_fit_leaves_none(
    built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    before = contents(built)
    with at_most(1_000), pytest.raises(PlatformError, match="File too large; "):
        validate(built)
    assert list(tmp_path.iterdir()) == []
    assert contents(built) == before
