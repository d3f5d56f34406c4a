"""Errors of the file system name path, cause and how to go on; those of the machine end with exit code 4."""

from __future__ import annotations

import errno
import io
import os
from pathlib import Path
from typing import Any

import pytest
from tests.file_size import at_most

from branchdrive.cli import main as command_line
from branchdrive.cli.main import run, validate_run
from branchdrive.errors import PlatformError
from branchdrive.formats.durable import replace_file
from branchdrive.formats.folder import Folder
from branchdrive.runtime.executor import in_process

FAULTS = {
    "ENOSPC": "make room", "EDQUOT": "quota", "EFBIG": "ulimit -f", "EMFILE": "ulimit -n", "ENFILE": "stop other",
    "EIO": "its disk failed", "ENOLCK": "cannot lock",
}  # fmt: skip
WRONG = {
    "EACCES": "permissions", "EPERM": "permissions", "EROFS": "cannot be written", "ENOTDIR": "a part of the path",
    "EISDIR": "name a file", "ENAMETOOLONG": "shorter name", "ELOOP": "circle", "ENOENT": "check the path",
}  # fmt: skip


def test_every_error_has_path_cause_hint_and_exit_code(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, hint in (FAULTS | WRONG).items():
        number = getattr(errno, name)

        def failing(argv: Any, stdout: Any, stderr: Any, number: int = number) -> int:
            raise OSError(number, os.strerror(number), "some/where")

        monkeypatch.setattr(command_line, "_run_command", failing)
        stderr = io.StringIO()
        assert run([], io.StringIO(), stderr) == (4 if name in FAULTS else 2), name
        assert stderr.getvalue().startswith(f"branchdrive: some/where: {os.strerror(number)}; ")
        assert hint in stderr.getvalue()


def test_a_report_that_does_not_fit_leaves_nothing_behind(valid_root: Path, tmp_path: Path, quick: None) -> None:
    stderr, target = io.StringIO(), tmp_path / "report"
    with at_most(100):
        assert validate_run([str(valid_root), "--output", str(target)], io.StringIO(), stderr) == 4
    assert stderr.getvalue().startswith(f"branchdrive-validate: {target}: File too large; ")
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_does_not_fit_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "file"
    replace_file(path, b"old")
    with at_most(100), pytest.raises(OSError, match="File too large") as caught:
        replace_file(path, b"x" * 1000)
    assert Path(caught.value.filename).parent == tmp_path
    assert [(one.name, one.read_bytes()) for one in tmp_path.iterdir()] == [("file", b"old")]


def test_a_machine_that_cannot_read_makes_no_finding(valid_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    true = os.open

    def exhausted(path: Any, *arguments: Any, **options: Any) -> int:
        if path == "rollouts.parquet":
            raise OSError(errno.EMFILE, os.strerror(errno.EMFILE), path)
        return true(path, *arguments, **options)

    monkeypatch.setattr(os, "open", exhausted)
    monkeypatch.setattr("branchdrive.runtime.executor.isolated", lambda jobs: in_process)
    stdout, stderr = io.StringIO(), io.StringIO()
    assert validate_run([str(valid_root)], stdout, stderr) == 4
    assert stdout.getvalue() == ""
    message = f"branchdrive-validate: {valid_root}/raw/shard-00000/rollouts.parquet: Too many open files; "
    assert stderr.getvalue().startswith(message)
    assert stderr.getvalue().count("\n") == 1


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="reads what Linux cannot read")
def test_a_disk_that_fails_is_no_matter_of_the_file() -> None:
    with (
        Folder(Path("/proc/self")).open("mem") as stream,
        pytest.raises(PlatformError, match=r"/proc/self/mem: Input/output error; its disk failed"),
    ):
        stream.read(1)
