"""A collection as a process that tests can stop."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path


def heed_interrupts() -> None:
    """Undo what a background shell does to its children: they ignore interrupts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def start(
    root: Path,
    *,
    seed: int,
    jobs: int,
    groups: int,
    options: Sequence[object] = (),
    loaded_first: Path | None = None,
) -> subprocess.Popen[str]:
    """`branchdrive collect` in a session of its own; interpreters load `sitecustomize` of a folder first, if given."""
    arguments = ["collect", root, "--groups", groups, "--seed", seed, "--jobs", jobs, *options]
    return subprocess.Popen(
        [sys.executable, "-m", "branchdrive.cli", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, **({"PYTHONPATH": str(loaded_first)} if loaded_first else {})},
        preexec_fn=heed_interrupts,
    )


def finished_rollouts(root: Path) -> int:
    """Number of rollouts that are staged."""
    return len([path for path in root.glob(".staging/groups/*/*") if not path.name.startswith(".")])


def session_of(pid: int) -> list[int]:
    """Living processes of a session, by `/proc`."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, session = path.read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue
        if int(session) == pid and state != "Z":
            found.append(int(path.parent.name))
    return found
