"""Archives of media: uncompressed USTAR files whose bytes depend on the images and their names alone.

Readers of WebDataset see a sample for every saved observation: what lies before the first dot of a name, with an image
for each camera.

Source: spec/05-raw-streams.md#media.
"""

from __future__ import annotations

import tarfile
from collections.abc import Mapping
from types import MappingProxyType
from typing import BinaryIO

__all__ = ["HEADER_BYTES", "MAX_CAMERA_NAME", "MEDIA_FILE", "SUFFIXES", "MediaArchive", "holds_member", "member_name"]

MEDIA_FILE = "media.tar"
"""Archive of a shard."""

SUFFIXES: Mapping[str, str] = MappingProxyType({"jpeg": "jpg", "png": "png"})
"""Suffix of a member by the encoding of its image."""

HEADER_BYTES = tarfile.BLOCKSIZE
"""Bytes before a member that say what it is."""

MAX_CAMERA_NAME = 88
"""Characters of a camera's name that fit into the 100 of a member's, beside a tick and a suffix."""


def member_name(rollout_id: str, tick: int, camera: str, encoding: str) -> str:
    """Name of the member that holds an image."""
    return f"{rollout_id}/{tick:06d}.{camera}.{SUFFIXES[encoding]}"


def holds_member(header: bytes, num_bytes: int) -> bool:
    """Whether the block before some bytes of an archive makes them a member: a file of that size, by POSIX or GNU."""
    try:
        member = tarfile.TarInfo.frombuf(header, "ascii", "surrogateescape")
    except (tarfile.HeaderError, ValueError):
        return False
    return header[257:262] == b"ustar" and member.isreg() and member.size == num_bytes


class MediaArchive:
    """Writes an archive member by member; nothing of it stays in memory.

    Args:
        stream: Where to write, from the beginning of the archive.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self.num_bytes = 0

    def add(self, name: str, image: bytes | memoryview) -> int:
        """Append a member; the position of its image in the archive."""
        member = tarfile.TarInfo(name)
        member.size = len(image)
        offset = self.num_bytes + tarfile.BLOCKSIZE
        self._write(member.tobuf(tarfile.USTAR_FORMAT))
        self._write(image)
        self._write(bytes(-len(image) % tarfile.BLOCKSIZE))
        return offset

    def end(self) -> None:
        """Write the mark of the archive's end; the stream stays open."""
        self._write(bytes(-(self.num_bytes + 2 * tarfile.BLOCKSIZE) % tarfile.RECORDSIZE + 2 * tarfile.BLOCKSIZE))

    def _write(self, content: bytes | memoryview) -> None:
        self._stream.write(content)
        self.num_bytes += len(content)
