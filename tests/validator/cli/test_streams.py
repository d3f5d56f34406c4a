"""Exit codes hold where nobody can read what a command writes."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from tests.validator.engine.datasets import write

SCRIPT = Path(sys.executable).with_name("branchdrive-validate")


@pytest.fixture
def incomplete(tmp_path: Path) -> str:
    """A command whose verdict is `partial`, on a dataset without shards, which takes no worker processes."""
    root = write(tmp_path / "dataset", {})
    return f"{shlex.quote(str(SCRIPT))} {shlex.quote(str(root))} --select BD-LAY"


def test_closed_and_full_streams_leave_the_exit_code(incomplete: str, valid_root: Path) -> None:
    with_workers = f"{shlex.quote(str(SCRIPT))} {shlex.quote(str(valid_root))} --select BD-LAY"
    nowhere = f"{shlex.quote(str(SCRIPT))} /nonexistent-dataset"
    expected = {
        f"{incomplete} >&-": 3, f"{incomplete} 2>&-": 3, f"{with_workers} >&- 2>&-": 3, f"{incomplete} >/dev/full": 4,
        f"{incomplete} 2>/dev/full": 3, f"{nowhere} 2>&-": 2, f"{nowhere} 2>/dev/full": 2, f"{nowhere} >&-": 2,
    }  # fmt: skip
    done = {
        line: subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False) for line in expected
    }
    assert {line: run.returncode for line, run in done.items()} == expected
    assert not any("Traceback" in run.stderr for run in done.values())


def test_a_device_and_a_link_are_not_written_over(incomplete: str, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "target")
    for place in ("/dev/stdout", tmp_path / "link"):
        line = f"{incomplete} --output {place}"
        run = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False)
        assert run.returncode == 2
        assert run.stderr.count("\n") == 1 and "is not a regular file" in run.stderr
    assert (tmp_path / "link").is_symlink()
