"""A file that is read from its start on, once: digested on the way, and seen a part at a time."""

from __future__ import annotations

import hashlib
from typing import BinaryIO

__all__ = ["FilePart"]

_PIECE_BYTES = 1 << 20


class FilePart:
    """The part of a file that is in memory.

    Args:
        stream: The file, at its beginning.
        is_hashed: Whether it is digested; then every byte is read, and what is seen are the bytes that are digested.
    """

    def __init__(self, stream: BinaryIO, is_hashed: bool) -> None:
        self._stream = stream
        self._base, self._bytes = 0, b""
        self.digest = hashlib.sha256() if is_hashed else None

    def bytes_at(self, offset: int, size: int) -> bytes:
        """Bytes of the file, fewer where it ends; offsets do not fall from call to call."""
        stop = offset + size
        while self._base + len(self._bytes) < stop:
            if self.digest is None and offset > self._base + len(self._bytes):
                self._stream.seek(offset)
                self._base, self._bytes = offset, b""
            piece = self._stream.read(max(_PIECE_BYTES, min(stop - self._base - len(self._bytes), size)))
            if not piece:
                break
            if self.digest is not None:
                self.digest.update(piece)
            kept = self._bytes[max(offset - self._base, 0) :]
            self._base += len(self._bytes) - len(kept)
            self._bytes = kept + piece
        return self._bytes[max(offset - self._base, 0) : stop - self._base]

    def finish(self) -> str:
        """Digest of the whole file; reads the rest of it."""
        if self.digest is None:
            raise ValueError("the file is not digested")
        while piece := self._stream.read(_PIECE_BYTES):
            self.digest.update(piece)
        return self.digest.hexdigest()
