"""Errors of the file system: path, cause and how to go on as text, and whether the machine or a path is to blame."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager

from branchdrive.errors import PlatformError

__all__ = ["file_error_text", "is_machine_fault", "machine_faults", "named"]

_MACHINE_FAULTS = {
    errno.ENOSPC: "make room on its disk and run the same command again",
    errno.EDQUOT: "make room within your quota and run the same command again",
    errno.EFBIG: "files of this size are not allowed here; raise `ulimit -f` or choose another disk, and run the same "
    "command again",
    errno.EMFILE: "this process may not open more files; raise `ulimit -n` and run the same command again",
    errno.ENFILE: "the machine may not open more files; stop other programs and run the same command again",
    errno.ENOMEM: "stop other programs or use fewer `--jobs`, and run the same command again",
    errno.EAGAIN: "the machine has no process or lock left; stop other programs or use fewer `--jobs`",
    errno.EIO: "its disk failed; look into the system's log before you trust the disk again",
    errno.ENOLCK: "its file system cannot lock files; choose a folder on a local disk",
    errno.ENOSYS: "its file system lacks a call; choose a folder on a local disk",
    errno.ENOTSUP: "its file system lacks a call; choose a folder on a local disk",
}
"""What to do where no other arguments of the same command would help on this machine as it is."""

_WRONG_PATHS = {
    errno.EACCES: "change its permissions, or name another path",
    errno.EPERM: "change its permissions or attributes, or name another path",
    errno.EROFS: "its file system cannot be written; name a path on another one",
    errno.ENOENT: "check the path",
    errno.ENOTDIR: "a part of the path is a file; name another path",
    errno.EISDIR: "it is a folder; name a file",
    errno.EEXIST: "it is there already; name another path, or move it away",
    errno.ENOTEMPTY: "the folder holds other files; move them out of it",
    errno.ENAMETOOLONG: "choose a shorter name",
    errno.ELOOP: "links lead in a circle; name another path",
    errno.EXDEV: "it lies on another file system than the rest of its folder; choose a folder without mounts in it",
    errno.EBUSY: "another program uses it; stop that one, or name another path",
    errno.ETXTBSY: "another program uses it; stop that one, or name another path",
}


def is_machine_fault(error: OSError) -> bool:
    """Whether the machine is to blame: no room, no descriptors, a broken disk."""
    return error.errno in _MACHINE_FAULTS


def file_error_text(error: OSError) -> str:
    """Path, cause and how to go on, as far as the error has them."""
    hint = _MACHINE_FAULTS.get(error.errno or 0) or _WRONG_PATHS.get(error.errno or 0)
    cause = error.strerror or str(error) or type(error).__name__
    place = f"{os.fsdecode(error.filename)}: " if isinstance(error.filename, str | bytes | os.PathLike) else ""
    return place + cause + (f"; {hint}" if hint else "")


@contextmanager
def named(path: str | os.PathLike[str]) -> Iterator[None]:
    """Let errors of the file system name `path` where they name none: those of reading and writing do not."""
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = os.fspath(path)
        raise


@contextmanager
def machine_faults(path: str | os.PathLike[str]) -> Iterator[None]:
    """Tell faults of the machine from those of a dataset: they are no finding.

    Raises:
        PlatformError: The machine is to blame.
    """
    try:
        yield
    except OSError as error:
        if is_machine_fault(error):
            error.filename = os.fspath(path)  # the whole path, also where a folder's descriptor was used
            raise PlatformError(file_error_text(error)) from error
        raise
