"""A folder of one user's own, in which values wait under names until a later run asks for them.

What lies in it is written whole or not at all, by any number of processes. Nobody else may have written in it, and
yet no value is believed: one that is damaged, cut off or another's is none.
"""

from __future__ import annotations

import errno
import os
import stat
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from branchdrive.errors import UsageError
from branchdrive.formats.entry import MAX_ENTRY_BYTES, DamagedError, sealed, unsealed
from branchdrive.formats.file_error import machine_faults

__all__ = ["PrivateFolder"]

_PRIVATE = 0o700
_SUFFIX = ".entry"
_PARTIAL = ".partial"


@dataclass(frozen=True)
class PrivateFolder:
    """A folder of values; it travels to workers.

    Attributes:
        path: The folder.
    """

    path: Path

    def __str__(self) -> str:
        return str(self.path)

    @classmethod
    def at(cls, path: Path | str) -> PrivateFolder:
        """The folder at a path, which is made where it is missing.

        Raises:
            UsageError: What is there is no folder, another user's, or open to others.
        """
        folder = Path(os.path.abspath(path))  # noqa: PTH100  (workers may be in another folder; links stay)
        with suppress(FileExistsError):
            folder.mkdir(_PRIVATE, parents=True)
        status = folder.stat()
        if not stat.S_ISDIR(status.st_mode):
            raise UsageError(f"{str(folder)!r} is not a folder; name one for the cache")
        if status.st_uid != os.geteuid() or stat.S_IMODE(status.st_mode) & 0o077:
            raise UsageError(
                f"{str(folder)!r} belongs to another user or is open to others, who could put verdicts into it; "
                f"name a folder of your own, or run: chmod 700 {str(folder)!r}"
            )
        return cls(folder)

    def get(self, name: str) -> bytes | None:
        """What was put under a name, which counts as used now; ``None`` if nothing was.

        Raises:
            DamagedError: It is not what was put there.
            PlatformError: The machine is to blame.
        """
        path = self._path(name)
        try:
            with machine_faults(path):
                content = _read(path)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise DamagedError(str(path)) from error
        return unsealed(name, content)

    def put(self, name: str, value: bytes) -> None:
        """Keep a value; of several under one name, the last stays, and none takes the place of a folder.

        Raises:
            OSError: Nothing can be written there.
            PlatformError: The machine is to blame, a full disk for example.
        """
        content = sealed(name, value)
        if content is None:
            return
        with machine_faults(self.path):
            descriptor, partial = tempfile.mkstemp(_PARTIAL, dir=self.path)
            try:
                # A power cut may leave a part of it, which its digest tells.
                with os.fdopen(descriptor, "wb") as stream:
                    stream.write(content)
                with suppress(IsADirectoryError):
                    Path(partial).replace(self._path(name))
            finally:
                Path(partial).unlink(missing_ok=True)

    def prune(self, max_bytes: int) -> None:
        """Remove what was not used for longest until no more than `max_bytes` lie there."""
        found: list[tuple[float, int, str]] = []
        with os.scandir(self.path) as entries:
            for entry in entries:
                if entry.name.endswith((_SUFFIX, _PARTIAL)):
                    with suppress(OSError):  # another run prunes too
                        status = entry.stat(follow_symlinks=False)
                        found.append((status.st_mtime, status.st_size, entry.path))
        excess = sum(size for _, size, _ in found) - max_bytes
        for _, size, path in sorted(found):
            if excess <= 0:
                return
            with suppress(OSError):
                Path(path).unlink()
            excess -= size

    def _path(self, name: str) -> Path:
        return self.path / f"{name}{_SUFFIX}"


def _read(path: Path) -> bytes:
    """Content of a regular file of this user, of a size that is kept; it counts as used now.

    Raises:
        OSError: It cannot be read, or is something else.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        status = os.fstat(descriptor)
        is_own = stat.S_ISREG(status.st_mode) and status.st_uid == os.geteuid()
        if not is_own or status.st_size > MAX_ENTRY_BYTES:
            raise PermissionError(errno.EACCES, "no regular file of this user", os.fspath(path))
        with suppress(OSError):
            os.utime(descriptor)
        with os.fdopen(descriptor, "rb", closefd=False) as stream:
            return stream.read()
    finally:
        os.close(descriptor)
