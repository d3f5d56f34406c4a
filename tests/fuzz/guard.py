"""What a validation must not do to the machine: write, remove, start or connect anything outside of its own folder.

One audit hook of the interpreter notes it; the same hook lets a file change at the moment it is opened.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from branchdrive.runtime import fork_server

__all__ = ["Guard"]

_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_CHANGES = {
    "os.remove": 1, "os.rename": 2, "os.mkdir": 2, "os.rmdir": 1, "os.link": 2, "os.symlink": 2, "os.chmod": 2,
    "os.chown": 3, "os.truncate": None, "os.utime": 3,
}  # fmt: skip
"""Events that change the file system, and the place of the folder's descriptor among their arguments."""

_STARTS = ("os.system", "os.exec", "os.posix_spawn", "subprocess.Popen", "socket.connect", "socket.bind", "os.fork")


_WORKERS = fork_server.__file__
"""The script that forks the validator's own workers, which is the one program that it starts."""


class Guard:
    """The audit hook of this process; there is one, since none can be taken away."""

    def __init__(self, own: Path) -> None:
        self._own = f"{own.resolve()}{os.sep}"
        self._violations: list[str] | None = None
        self._victim, self._change = "", None
        sys.addaudithook(self._note)

    @contextmanager
    def watching(self, victim: str = "", change: Callable[[], object] | None = None) -> Iterator[list[str]]:
        """Note violations inside the block; `change` happens before a file called `victim` is first opened."""
        found: list[str] = []
        self._victim, self._change = victim, change
        self._violations = found
        try:
            yield found
        finally:
            self._violations, self._change = None, None

    def _note(self, event: str, arguments: tuple[Any, ...]) -> None:
        found = self._violations
        if found is None:
            return
        if event == "open":
            path, _, flags = arguments
            change = self._change
            if change is not None and isinstance(path, str) and path.rpartition("/")[2] == self._victim:
                self._violations, self._change = None, None  # what the change does is no violation
                change()
                self._violations = found
            is_named = not isinstance(path, int)  # else a file or pipe that was opened before
            if flags & _WRITES and is_named and path != os.devnull and not self._is_own(path, None):
                found.append(f"{event} {path!r} for writing")
        elif event in _CHANGES:
            place = _CHANGES[event]
            folder = arguments[place] if place is not None and len(arguments) > place else None
            if not self._is_own(arguments[0], folder):
                found.append(f"{event} {arguments[0]!r}")
        elif event in _STARTS and not (event == "subprocess.Popen" and _WORKERS in arguments[1]):
            found.append(event)

    def _is_own(self, path: Any, folder: Any) -> bool:
        if isinstance(path, int):
            path = str(Path(f"/proc/self/fd/{path}").readlink())
        text = os.fsdecode(path)
        if not text.startswith(os.sep) and isinstance(folder, int) and folder >= 0:
            text = f"{Path(f'/proc/self/fd/{folder}').readlink()}/{text}"
        return os.path.abspath(text).startswith(self._own)  # noqa: PTH100 - no link is followed
