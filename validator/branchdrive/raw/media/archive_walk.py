"""An archive of media, followed from its first byte to its last along the images that rows name.

Every byte is accounted for: headers of plain members, images that the index names under the names of their rows, zeros
that fill blocks, and the mark of the end. Whatever else an archive holds is found as what lies between these.

Source: spec/05-raw-streams.md#archives.
"""

from __future__ import annotations

import tarfile
from collections.abc import Sequence

from branchdrive.contract.mismatch import Location, Mismatch, Mismatches
from branchdrive.contract.text import quote
from branchdrive.formats.file_part import FilePart
from branchdrive.formats.media_archive import (
    BLOCK_BYTES,
    block_text,
    member_header,
    member_name,
    read_member,
    whole_blocks,
)
from branchdrive.raw.media.image_claims import ImageKey

__all__ = ["ARCHIVE_SUFFIX", "ArchiveWalk"]

ARCHIVE_SUFFIX = ".tar"
"""What the name of an archive ends in."""

_END_BYTES = 2 * BLOCK_BYTES
"""Bytes of the mark of an end, at least."""


class ArchiveWalk:
    """Follows one archive; members come in the order of their bytes.

    Args:
        path: The archive, relative to the root of the dataset.
        part: Its bytes.
        found: Where mismatches are noted.
    """

    def __init__(self, path: str, part: FilePart, found: Mismatches) -> None:
        self._path, self._part, self._found = path, part, found
        self._filled, self._next = 0, 0
        self._last = ImageKey("", -1, "")
        self._attempts: set[str] = set()

    def member(self, offset: int, size: int, keys: Sequence[ImageKey], encoding: str) -> None:
        """Look at what lies before an image and at its header.

        Args:
            offset: First byte of the image.
            size: Its bytes.
            keys: The images that rows say it is, one at least.
            encoding: The encoding of the first of them.
        """
        start, key = offset - BLOCK_BYTES, keys[0]
        if start < self._next:
            self._blame(key, f"an image from byte {self._next + BLOCK_BYTES} on, behind a header", f"one from {offset}")
        else:
            self._look_between(start)
            self._look_at_header(start, size, key, encoding)
        if len(keys) > 1:
            self._blame(key, "a member that one row names", f"one that {len(keys):,} rows name")
        self._look_at_order(key)
        self._filled = max(self._filled, offset + size)
        self._next = whole_blocks(self._filled)

    def end(self, num_bytes: int) -> None:
        """Look at what lies behind the last image of an archive of some size."""
        least = self._next + _END_BYTES
        most = -(-least // tarfile.RECORDSIZE) * tarfile.RECORDSIZE
        rest = self._part.bytes_at(self._filled, most - self._filled)
        if any(rest) or not least <= num_bytes <= most or num_bytes % BLOCK_BYTES:
            expected = f"two blocks of zeros from byte {self._next} on, and nothing behind byte {most}"
            first = self._filled + len(rest) - len(rest.lstrip(b"\0"))
            block = rest[whole_blocks(first + 1) - BLOCK_BYTES - self._filled :][:BLOCK_BYTES]
            found = f"{num_bytes - self._next} bytes" if not any(rest) else f"at byte {first} {block_text(block)}"
            self._found.add(Mismatch({"file": self._path}, expected, found))

    def _look_between(self, start: int) -> None:
        """What lies between the last image and the header of the next."""
        filling = self._part.bytes_at(self._filled, self._next - self._filled)
        if any(filling):
            expected = f"zeros from byte {self._filled} to {self._next}, behind an image"
            self._found.add(Mismatch({"file": self._path}, expected, "other bytes"))
        if start > self._next:
            expected = f"the header of an image that a row names at byte {self._next}"
            found = block_text(self._part.bytes_at(self._next, BLOCK_BYTES))
            self._found.add(Mismatch({"file": self._path}, expected, found))

    def _look_at_header(self, start: int, size: int, key: ImageKey, encoding: str) -> None:
        block = self._part.bytes_at(start, BLOCK_BYTES)
        name = member_name(*key, encoding)
        if block == _usual_header(name, size):
            return
        member = read_member(block)
        if member is None:
            expected = f"a header of a plain member of {size} bytes at byte {start}, in the form of POSIX"
            self._blame(key, expected, block_text(block))
        elif member.num_bytes != size:
            self._blame(key, f"a member of {size} bytes", f"one of {member.num_bytes}")
        elif member.name != name:
            self._blame(key, f"a member with the name {quote(name)}", quote(member.name))

    def _look_at_order(self, key: ImageKey) -> None:
        """Members of an attempt lie together, by tick and camera."""
        is_next = key > self._last if key.rollout_id == self._last.rollout_id else key.rollout_id not in self._attempts
        if not is_next:
            last = self._last
            found = f"it behind tick {last.tick} of {last.camera} of {quote(last.rollout_id)}"
            self._blame(key, "images of an attempt together, by tick and camera", found)
        self._attempts.add(key.rollout_id)
        self._last = key

    def _blame(self, key: ImageKey, expected: str, found: str) -> None:
        place: Location = {"file": self._path, "table": "frames", **key._asdict()}
        self._found.add(Mismatch(place, expected, found))


def _usual_header(name: str, size: int) -> bytes | None:
    """The header that nearly all members have; ``None`` where there is none for a name."""
    try:
        return member_header(name, size)
    except ValueError:
        return None
