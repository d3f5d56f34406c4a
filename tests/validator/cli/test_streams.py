"""Exit codes hold where nobody can read what a command writes."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from tests.sampling import sampled
from tests.validator.engine.datasets import write

SCRIPT = Path(sys.executable).with_name("branchdrive-validate")


@pytest.fixture
def incomplete(tmp_path: Path) -> str:
    """A command whose verdict is `partial`, on a dataset without shards, which takes no worker processes."""
    root = write(tmp_path / "dataset", {})
    return f"{shlex.quote(str(SCRIPT))} {shlex.quote(str(root))} --select BD-LAY"


@pytest.fixture
def commands(incomplete: str, valid_root: Path) -> dict[str, str]:
    """That one, one with worker processes, and one on what is not there."""
    with_workers = f"{shlex.quote(str(SCRIPT))} {shlex.quote(str(valid_root))} --select BD-LAY"
    nowhere = f"{shlex.quote(str(SCRIPT))} /nonexistent-dataset"
    return {"incomplete": incomplete, "with workers": with_workers, "nowhere": nowhere}


@pytest.mark.parametrize(
    ("command", "streams", "code"),
    sampled([
        ("incomplete", ">&-", 3), ("incomplete", "2>&-", 3), ("with workers", ">&- 2>&-", 3), ("nowhere", ">&-", 2),
        ("incomplete", ">/dev/full", 4), ("incomplete", "2>/dev/full", 3), ("nowhere", "2>&-", 2),
        ("nowhere", "2>/dev/full", 2),
    ], every=2),
)  # fmt: skip
def test_closed_and_full_streams_leave_the_exit_code(
    commands: dict[str, str], command: str, streams: str, code: int
) -> None:
    line = f"{commands[command]} {streams}"
    run = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False)
    assert run.returncode == code
    assert "Traceback" not in run.stderr


def test_a_device_and_a_link_are_not_written_over(incomplete: str, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "target")
    for place in ("/dev/stdout", tmp_path / "link"):
        line = f"{incomplete} --output {place}"
        run = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False)
        assert run.returncode == 2
        assert run.stderr.count("\n") == 1 and "is not a regular file" in run.stderr
    assert (tmp_path / "link").is_symlink()
