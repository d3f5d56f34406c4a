"""Exclusive locks between processes, given back by the system when a process dies."""

from __future__ import annotations

import fcntl
import os
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from branchdrive.formats.file_error import named

__all__ = ["FileLock"]


class FileLock:
    """An exclusive lock that a file at `path` stands for; the file has no content.

    A forked child does not inherit the lock: a worker pool that outlives its killed parent blocks no one.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor: int | None = None

    @property
    def is_held(self) -> bool:
        """Whether this object holds the lock."""
        return self._descriptor is not None

    @staticmethod
    def held_here(path: Path) -> bool:
        """Whether some object of this process holds the lock at `path`; waiting for it may then take forever."""
        return path.exists() and any(lock.path.exists() and lock.path.samefile(path) for lock in _held)

    def acquire(self, *, blocking: bool, create: bool = True) -> bool:
        """Take the lock, waiting for its holder if `blocking`; whether it was taken.

        Raises:
            FileNotFoundError: The file's folder is missing or, if not `create`, the file itself.
        """
        flags = os.O_RDWR | os.O_CLOEXEC | (os.O_CREAT if create else 0)
        while True:
            descriptor = os.open(self.path, flags, 0o644)
            try:
                with named(self.path):
                    fcntl.flock(descriptor, fcntl.LOCK_EX if blocking else fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(descriptor)
                return False
            except BaseException:
                os.close(descriptor)
                raise
            if self._names(descriptor):
                self._descriptor = descriptor
                _held.add(self)
                return True
            os.close(descriptor)  # the file was removed while we waited; lock the one that now has its name

    def _names(self, descriptor: int) -> bool:
        try:
            return os.path.samestat(os.fstat(descriptor), self.path.stat())
        except FileNotFoundError:
            return False

    def release(self) -> None:
        """Give the lock back; nothing happens if it is not held."""
        if self._descriptor is not None:
            descriptor, self._descriptor = self._descriptor, None
            _held.discard(self)
            os.close(descriptor)

    def remove(self) -> None:
        """Remove the file and give the lock back; removed after that, it could be a file that another process holds."""
        self.path.unlink(missing_ok=True)
        self.release()

    def __enter__(self) -> Self:
        self.acquire(blocking=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


_held: set[FileLock] = set()


def _forget_locks_of_parent() -> None:
    # Closing the child's copy of a descriptor leaves the parent's lock in place.
    for lock in list(_held):
        with suppress(OSError):  # one descriptor that is gone must not leave the child with the others
            lock.release()


os.register_at_fork(after_in_child=_forget_locks_of_parent)
