"""A command and everything that it starts, which end together, and with the process that asked for the command.

Run as a script, with the words of the command as arguments, by `branchdrive.pilot.rerun`. Standard input is a pipe that
nothing is written into: when its other end is closed, also because the process that holds it was killed, the command is
killed. Standard output says ``started``, and ``exit CODE`` in the end, or ``error ERRNO`` where the command cannot be
started. Standard error is the command's output.

On Linux this process adopts what the command leaves behind (``PR_SET_CHILD_SUBREAPER``), so that a process that has
made itself a session of its own, or whose parent has ended, ends too. Other systems have no such call: there, processes
of the command's process group end, and those that left it do not.

It imports nothing but the standard library, so that it starts at once.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

_SET_PARENT_DEATH_SIGNAL, _SET_CHILD_SUBREAPER = 1, 36
"""Options of Linux's ``prctl``."""

_PROC = Path("/proc")
_PAUSE_S = 0.01


def _prctl(option: int, argument: int) -> None:
    """Call ``prctl``, where the system has it."""
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).prctl(option, argument, 0, 0, 0)


def _die_with_parent() -> None:
    _prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)


def _descendants(root: int) -> set[int]:
    """All processes that descend from one; none where there is no `/proc`."""
    children: dict[int, list[int]] = {}
    for path in _PROC.glob("[0-9]*/stat"):
        with suppress(OSError, ValueError, IndexError):
            children.setdefault(int(path.read_text().rpartition(")")[2].split()[1]), []).append(int(path.parent.name))
    found: set[int] = set()
    waiting = [root]
    while waiting:
        new = children.get(waiting.pop(), [])
        found.update(new)
        waiting += new
    return found


def _end_all(group: int) -> None:
    """Kill the command's process group and whatever descends from this process, until nothing is left that may be."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(group, signal.SIGKILL)
    while sum(map(_is_killed, _descendants(os.getpid()))):
        with suppress(ChildProcessError):  # no child is left, and on Linux no descendant
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        time.sleep(_PAUSE_S)


def _is_killed(pid: int) -> bool:
    """Kill a process; false where it is gone, or of another user."""
    try:
        os.kill(pid, signal.SIGKILL)
    except (ProcessLookupError, PermissionError):
        return False
    return True


def _kill_when_alone(pid: int) -> None:
    """Kill a child once no process holds the other end of standard input."""
    sys.stdin.buffer.read()
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def main(words: list[str]) -> None:
    """Run the command to its end, or to that of the process that asked for it."""
    _prctl(_SET_CHILD_SUBREAPER, 1)
    try:
        process = subprocess.Popen(  # noqa: S603  (the user's own command, without a shell)
            words, stdin=subprocess.DEVNULL, stdout=2, stderr=2, start_new_session=True, preexec_fn=_die_with_parent
        )
    except OSError as error:
        _say(f"error {error.errno}")
        return
    _say("started")
    threading.Thread(target=_kill_when_alone, args=(process.pid,), daemon=True).start()
    pid, status = os.wait()
    while pid != process.pid:  # others are orphans that were adopted
        pid, status = os.wait()
    _end_all(process.pid)
    _say(f"exit {os.waitstatus_to_exitcode(status)}")


def _say(answer: str) -> None:
    """Answer the process that asked for the command, if it still listens."""
    with suppress(BrokenPipeError):
        os.write(1, f"{answer}\n".encode())


if __name__ == "__main__":
    main(sys.argv[1:])
    os._exit(0)  # the thread still reads
