"""Archives of media: uncompressed USTAR files whose bytes depend on the images and their names alone.

Readers of WebDataset see a sample for every saved observation: what lies before the first dot of a name, with an image
for each camera. Programs differ in what they make of links, extensions and odd headers, so that no archive of a
dataset may hold any: every member is a plain file, in the one form that all of them read alike.

Sources: spec/05-raw-streams.md#archives; POSIX.1-2017, pax, "ustar Interchange Format".
"""

from __future__ import annotations

import hashlib
import re
import tarfile
from collections.abc import Mapping
from types import MappingProxyType
from typing import BinaryIO, NamedTuple

from branchdrive.contract.text import quote

__all__ = [
    "BLOCK_BYTES", "MAX_CAMERA_NAME", "MEDIA_FILE", "SUFFIXES", "MediaArchive", "Member", "block_text", "member_header",
    "member_name", "read_member", "whole_blocks",
]  # fmt: skip

MEDIA_FILE = "media.tar"
"""Archive of a shard."""

SUFFIXES: Mapping[str, str] = MappingProxyType({"jpeg": "jpg", "png": "png"})
"""Suffix of a member by the encoding of its image."""

BLOCK_BYTES = tarfile.BLOCKSIZE
"""Bytes of a block: of the header before a member, and what the bytes of a member are filled up to."""

MAX_CAMERA_NAME = 88
"""Characters of a camera's name that fit into the 100 of a member's, beside a tick and a suffix."""


def member_name(rollout_id: str, tick: int, camera: str, encoding: str) -> str:
    """Name of the member that holds an image."""
    return f"{rollout_id}/{tick:06d}.{camera}.{SUFFIXES.get(encoding, encoding)}"


class Member(NamedTuple):
    """What a header says of a plain member."""

    name: str
    num_bytes: int


_NAME_BYTES, _FOLDER_BYTES = 100, 155

_PLAIN_OWNER = b"0000644\0" + 2 * b"0000000\0"
_PLAIN_TIME = b"\0" + b"0" * 11 + b"\0"
_PLAIN_KIND = b"\0 0" + bytes(100) + b"ustar\x0000" + bytes(32 + 32 + 8 + 8)
_PLAIN_SUM = sum(_PLAIN_OWNER + _PLAIN_TIME + _PLAIN_KIND) - ord(" ") + 8 * ord(" ")
"""What all headers add to their checksums, in which the checksum counts as blanks."""

_NUMBERS = re.compile(
    rb"(?:[0-7]{7}[ \0]){3}([0-7]{11})[ \0][0-7]{11}[ \0](?:[0-7]{6}[ \0]{2}|[0-7]{7}[ \0])0\0{100}ustar\x0000"
)
"""Mode, owner, group, size, time, checksum, the type of a regular file, no link, and the form of POSIX."""

_TEXT = re.compile(rb"([ -~]*)\0*")
_DEVICE = re.compile(rb"(?:[0-7]{7}[ \0]|\0{8}){2}")

_KINDS: Mapping[bytes, str] = MappingProxyType({
    b"\0": "a file of the form before POSIX", b"0": "a file", b"1": "a hard link", b"2": "a symbolic link",
    b"3": "a device", b"4": "a device", b"5": "a folder", b"6": "a pipe", b"L": "a long name of GNU",
    b"K": "a long link of GNU", b"S": "a sparse file of GNU", b"g": "an extended header", b"x": "an extended header",
})  # fmt: skip
"""What a member is by its type."""


def member_header(name: str, num_bytes: int) -> bytes:
    """The header before a member, with the times and owners 0 and the mode 644.

    Raises:
        ValueError: A header has no room for the name.
    """
    folder, _, own = name.rpartition("/") if len(name) > _NAME_BYTES else ("", "", name)
    texts = own.encode("ascii"), folder.encode("ascii")
    if not 0 < len(texts[0]) <= _NAME_BYTES or len(texts[1]) > _FOLDER_BYTES:
        raise ValueError(f"{quote(name)} is too long for a member of an archive")
    size = b"%011o" % num_bytes
    checksum = b"%06o" % (_PLAIN_SUM + sum(texts[0]) + sum(texts[1]) + sum(size))
    return b"".join((
        texts[0].ljust(_NAME_BYTES, b"\0"), _PLAIN_OWNER, size, _PLAIN_TIME, checksum, _PLAIN_KIND,
        texts[1].ljust(_FOLDER_BYTES, b"\0"), bytes(12),
    ))  # fmt: skip


def read_member(block: bytes) -> Member | None:
    """The plain member whose header a block is; ``None`` where it is none that every program reads alike."""
    numbers = _NUMBERS.fullmatch(block, 100, 265)
    if len(block) != BLOCK_BYTES or numbers is None or any(block[500:]):
        return None
    texts = [_TEXT.fullmatch(block, *span) for span in ((0, 100), (345, 500), (265, 297), (297, 329))]
    checksum = sum(block) - sum(block[148:156]) + 8 * ord(" ")
    if None in texts or not _DEVICE.fullmatch(block, 329, 345) or int(block[148:156].rstrip(b" \0"), 8) != checksum:
        return None
    name, prefix = (text[1].decode() for text in texts[:2] if text is not None)
    return Member(f"{prefix}/{name}" if prefix else name, int(numbers[1], 8))


def block_text(block: bytes) -> str:
    """What a block of an archive is that had to be a header of a plain member, for people."""
    if len(block) < BLOCK_BYTES:
        return "the end of the file"
    if not any(block):
        return "zeros, which end an archive"
    try:
        member = tarfile.TarInfo.frombuf(block, "ascii", "surrogateescape")
    except (tarfile.HeaderError, ValueError):
        return "no header"
    kind = _KINDS.get(member.type, "a member of unknown type")
    form = " in another form" if member.type == b"0" and read_member(block) is None else ""
    return f"{kind}{form}, {quote(member.name)} of {member.size} bytes"


def whole_blocks(num_bytes: int) -> int:
    """Bytes filled up to whole blocks."""
    return -(-num_bytes // BLOCK_BYTES) * BLOCK_BYTES


class MediaArchive:
    """Writes an archive member by member; nothing of it stays in memory.

    Args:
        stream: Where to write, from the beginning of the archive.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._hash = hashlib.sha256()
        self.num_bytes = 0

    @property
    def digest(self) -> str:
        """SHA-256 of what was written, hexadecimal."""
        return self._hash.hexdigest()

    def add(self, name: str, image: bytes | memoryview) -> int:
        """Append a member; the position of its image in the archive.

        Raises:
            ValueError: A header has no room for the name.
        """
        offset = self.num_bytes + BLOCK_BYTES
        self._write(member_header(name, len(image)))
        self._write(image)
        self._write(bytes(-len(image) % BLOCK_BYTES))
        return offset

    def end(self) -> None:
        """Write the mark of the archive's end; the stream stays open."""
        self._write(bytes(-(self.num_bytes + 2 * BLOCK_BYTES) % tarfile.RECORDSIZE + 2 * BLOCK_BYTES))

    def _write(self, content: bytes | memoryview) -> None:
        self._stream.write(content)
        self._hash.update(content)
        self.num_bytes += len(content)
