"""A file that is fetched by ranges: as few as reading takes, each of them whole."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

__all__ = ["FIRST_BYTES", "MOST_BYTES", "RangedFile"]

FIRST_BYTES = 1 << 20
"""Fetched at least where reading begins at the start of a file."""

_AHEAD_BYTES = 8 << 20
"""Fetched at least where reading goes on."""

MOST_BYTES = 64 << 20
"""Fetched at most at once."""


class RangedFile(io.RawIOBase):
    """A file for reading.

    A read in the middle fetches what it asks for alone; one that begins at the start or goes on where the last one
    ended fetches more, so that a file that is read in small pieces takes few requests.

    Args:
        size: Bytes of the file.
        fetch: Called with the first byte and the one behind the last; returns exactly these bytes.
        first: Its first bytes, where they are there already.
    """

    def __init__(self, size: int, fetch: Callable[[int, int], bytes], first: bytes = b"") -> None:
        super().__init__()
        self._size, self._fetch = size, fetch
        self._place = self._last = 0
        self._held, self._held_from = first, 0

    def readable(self) -> bool:
        """Yes."""
        return True

    def seekable(self) -> bool:
        """Yes."""
        return True

    def tell(self) -> int:
        """Where the next read begins."""
        return self._place

    def seek(self, offset: int, whence: int = io.SEEK_SET, /) -> int:
        """Begin the next read elsewhere; nothing is fetched."""
        self._place = max(0, offset + {io.SEEK_SET: 0, io.SEEK_CUR: self._place, io.SEEK_END: self._size}[whence])
        return self._place

    def read(self, size: int = -1, /) -> bytes:
        """The next bytes, all that are asked for unless the file ends; errors are those of `fetch`."""
        start = self._place
        stop = self._size if size is None or size < 0 else min(start + size, self._size)
        if start >= stop:
            return b""
        content = self._bytes(start, stop)
        self._place = self._last = stop
        return content

    def readall(self) -> bytes:
        """The rest of the file."""
        return self.read()

    def readinto(self, buffer: Any, /) -> int:
        """Fill a buffer as `read` does; returns how much of it."""
        view = memoryview(buffer).cast("B")
        content = self.read(len(view))
        view[: len(content)] = content
        return len(content)

    def _bytes(self, start: int, stop: int) -> bytes:
        held = b""
        if self._held_from <= start <= self._held_from + len(self._held):
            held = self._held[start - self._held_from : stop - self._held_from]
            if len(held) == stop - start:
                return held
        first, ahead = start + len(held), 0
        if start == 0 or start == self._last:
            ahead = FIRST_BYTES if start == 0 else _AHEAD_BYTES
        end = min(max(stop, first + ahead), self._size)
        pieces = [self._fetch(at, min(at + MOST_BYTES, end)) for at in range(first, end, MOST_BYTES)]
        fetched = pieces[0] if len(pieces) == 1 else b"".join(pieces)
        self._held, self._held_from = fetched[stop - first :], stop
        if not held and len(fetched) == stop - start:
            return fetched
        return held + fetched[: stop - first]
