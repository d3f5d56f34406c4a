"""Parts of PNG and JPEG images: what keeps one from being whole and plain, seen in one pass and without decoding.

Decoders differ in which odd files they read. What they may differ on is refused here, before one of them is asked.
Sources: PNG, third edition, 5.3 to 5.6 (https://www.w3.org/TR/png-3/); ITU-T T.81, B.1 and B.2.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple
from zlib import crc32

from branchdrive.contract.limits import spec_limits
from branchdrive.contract.text import quote

__all__ = ["FRAMES", "JPEG_START", "PNG_SIGNATURE", "Flaw", "find_flaw", "jpeg_segments", "pixel_parts", "png_data"]

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_START = b"\xff\xd8"

FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG that begin a frame, which has the size."""

_BEGIN, _END, _SCAN, _QUANTISATION, _HUFFMAN = 0xD8, 0xD9, 0xDA, 0xDB, 0xC4
_BARE = frozenset({0x01, *range(0xD0, 0xDA)})
"""Markers of JPEG that no length follows."""

_NOTES = frozenset({0xFE, *range(0xE1, 0xEE), 0xEF})
"""Markers of what a JPEG says beside its pixels: comments and applications but for JFIF and Adobe."""

_FILL = re.compile(rb"\xff*")
_MARKER_BEHIND_DATA = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")

_PIXEL_CHUNKS = frozenset({b"IHDR", b"IDAT", b"IEND"})
_ANIMATION = frozenset({b"acTL", b"fcTL", b"fdAT"})

_EXIF = 0xE1
"""Marker of what JPEG holds of EXIF and XMP."""

_TEXT = frozenset({b"tEXt", b"zTXt", b"iTXt"})
_EXIF_KEYWORD = re.compile(rb"(?i:exif|xmp|xml:com\.adobe\.xmp|raw profile type[^\0]*)\0")
"""Keywords of texts of a PNG in which readers look for EXIF and XMP, beside the chunk of its own."""

_NO_EXIF = "EXIF and XMP, which turn an image for some readers"


class Flaw(NamedTuple):
    """What an image is that it may not be.

    Attributes:
        is_of_form: Whether it is whole, but of a form that no image of a dataset may have.
        expected: What it had to be.
        found: What it is.
    """

    is_of_form: bool
    expected: str
    found: str


def find_flaw(image: bytes, encoding: str) -> Flaw | None:
    """The first flaw of an image that has a header; ``None`` where it is whole and plain.

    Raises:
        ValueError: The encoding is neither ``jpeg`` nor ``png``.
    """
    if encoding == "png":
        return _flaw_of_png(image)
    if encoding == "jpeg":
        return _flaw_of_jpeg(image)
    raise ValueError(f"unknown encoding {encoding!r}")


def pixel_parts(image: bytes, encoding: str) -> bytes:
    """A flawless image without its notes: what says nothing about pixels, but can keep a decoder from reading them."""
    if encoding == "png":
        parts = [image[start:stop] for kind, start, stop in _png_chunks(image) if kind in _PIXEL_CHUNKS]
        return PNG_SIGNATURE + b"".join(parts)
    parts = [image[start:stop] for marker, start, stop in jpeg_segments(image) if marker not in _NOTES]
    return JPEG_START + b"".join(parts)


def png_data(image: bytes) -> bytes:
    """The packed rows of a PNG."""
    return b"".join(image[start + 8 : stop - 4] for kind, start, stop in _png_chunks(image) if kind == b"IDAT")


def _png_chunks(image: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Kind, start and end of the chunks of a PNG, up to the first that is cut short."""
    start = len(PNG_SIGNATURE)
    while start + 12 <= len(image):
        length, kind = struct.unpack_from(">I4s", image, start)
        stop = start + 12 + length
        if stop > len(image):
            return
        yield kind, start, stop
        start = stop


def _flaw_of_png(image: bytes) -> Flaw | None:
    whole, limit = "a whole PNG", spec_limits().max_image_parts
    last, num_data, num_chunks = b"", 0, 0
    for kind, start, stop in islice(_png_chunks(image), limit):
        num_chunks += 1
        name = quote(kind.decode("latin-1"))
        if image[stop - 4 : stop] != crc32(memoryview(image)[start + 4 : stop - 4]).to_bytes(4, "big"):
            return Flaw(False, whole, f"a chunk {name} at byte {start} that does not have its checksum")
        if kind == b"tRNS":
            return Flaw(True, "a PNG without transparency", f"one with a chunk {name}")
        if kind == b"eXIf" or (kind in _TEXT and _EXIF_KEYWORD.match(image, start + 8, stop - 4)):
            return Flaw(True, f"a PNG without {_NO_EXIF}", f"one with a chunk {name} of it at byte {start}")
        if kind in _ANIMATION:
            return Flaw(True, "a PNG of one picture", f"one with a chunk {name}, of an animation")
        is_critical = not kind[0] & 0x20
        if is_critical and (kind not in _PIXEL_CHUNKS or (kind == b"IHDR" and last)):
            return Flaw(True, "a PNG of the critical chunks IHDR, IDAT and IEND", f"another {name} at byte {start}")
        if kind == b"IDAT":
            if num_data and last != b"IDAT":
                return Flaw(True, "a PNG whose chunks IDAT follow each other", f"one between them at byte {start}")
            num_data += 1
        if kind == b"IEND":
            if not num_data:
                return Flaw(False, whole, "one without data")
            if stop - start > 12:
                return Flaw(False, whole, f"{stop - start - 12:,} bytes in `IEND`")
            rest = len(image) - stop
            return Flaw(False, whole, f"{rest:,} bytes behind `IEND`") if rest else None
        last = kind
    if num_chunks == limit:
        return Flaw(True, f"a PNG of at most {limit:,} chunks", "one of more")
    return Flaw(False, whole, "one that is cut short")


def jpeg_segments(image: bytes) -> Iterator[tuple[int, int, int]]:
    """Marker, start and end of the segments of a JPEG behind its first marker; a scan has its data.

    The last of them ends the image, or there is none such and what follows is no segment, or is cut short.
    """
    stop = len(JPEG_START)
    while True:
        fill = _FILL.match(image, stop)
        start = stop if fill is None else fill.end() - 1
        if start < stop or start + 2 > len(image) or (marker := image[start + 1]) == 0:
            return
        stop = start + 2
        if marker not in _BARE:
            if start + 4 > len(image):
                return
            (length,) = struct.unpack_from(">H", image, start + 2)
            stop += length
            if length < 2 or stop > len(image):
                return
        if marker == _SCAN:
            behind = _MARKER_BEHIND_DATA.search(image, stop)
            stop = len(image) if behind is None else behind.start()
        yield marker, start, stop
        if marker == _END:
            return


def _flaw_of_jpeg(image: bytes) -> Flaw | None:
    whole, limits = "a whole JPEG", spec_limits()
    if (num_scans := image.count(b"\xff\xda")) > limits.max_image_scans:
        expected = f"a JPEG of at most {limits.max_image_scans} scans"
        return Flaw(True, expected, f"one with {num_scans:,} markers of a scan")
    seen: set[int] = set()
    stop, num_segments = len(JPEG_START), 0
    for marker, start, stop in islice(jpeg_segments(image), limits.max_image_parts):
        num_segments += 1
        if marker == _BEGIN or (marker in FRAMES and seen & FRAMES):
            return Flaw(False, whole, f"a second image inside of it, at byte {start}")
        if marker == _EXIF:
            return Flaw(True, f"a JPEG without {_NO_EXIF}", f"one with a segment of it at byte {start}")
        if marker == _SCAN:
            if not seen & FRAMES or not {_QUANTISATION, _HUFFMAN} <= seen:
                return Flaw(False, whole, f"a scan without the tables that it needs, at byte {start}")
            if stop - start - 2 <= int.from_bytes(image[start + 2 : start + 4], "big"):
                return Flaw(False, whole, f"a scan without data, at byte {start}")
        if marker == _END:
            if _SCAN not in seen:
                return Flaw(False, whole, "one without a scan")
            rest = len(image[stop:].rstrip(b"\x00"))
            return Flaw(False, whole, f"{rest:,} bytes behind its end marker") if rest else None
        seen.add(marker)
    if num_segments == limits.max_image_parts:
        return Flaw(True, f"a JPEG of at most {limits.max_image_parts:,} segments", "one of more")
    return Flaw(False, whole, "one that is cut short" if stop == len(image) else f"no whole segment at byte {stop}")
