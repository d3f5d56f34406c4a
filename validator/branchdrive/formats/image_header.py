"""Headers of encoded images: what an image claims to be, read from its first bytes without decoding it.

What a header says is a claim; it bounds what decoding may take. Only forms that every decoder reads are known: PNG of
8 bits, RGB or grey, without interlacing; baseline and progressive JPEG of 8 bits and three channels.

Source: ISO/IEC 15948 (PNG), clause 11.2.2; ITU-T T.81 (JPEG), annex B.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import NamedTuple
from zlib import crc32

from branchdrive.errors import DecodeError

__all__ = ["CHANNELS", "SIGNATURES", "ImageHeader", "is_whole", "png_chunks", "read_header"]

SIGNATURES = {"jpeg": b"\xff\xd8\xff", "png": b"\x89PNG\r\n\x1a\n"}
"""First bytes of an image by its encoding."""

CHANNELS = {1: "grey", 3: "RGB"}
"""Number of channels that an image may have, and what it is called."""

_JPEG_END = b"\xff\xd9"
_PNG_END = b"\x00\x00\x00\x00IEND\xaeB`\x82"
_PNG_HEADER = struct.Struct(">I4sIIBBBBB")
_PNG_CHANNELS = {0: 1, 2: 3}
_FRAMES = {0xC0: "baseline", 0xC2: "progressive"}
_OTHER_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_SCAN, _END = 0xDA, 0xD9
_MAX_SEGMENTS = 256


class ImageHeader(NamedTuple):
    """What an image claims to be.

    Attributes:
        encoding: ``jpeg`` or ``png``.
        width_px: Columns.
        height_px: Rows.
        channels: 3 for RGB, 1 for grey.
        num_bytes: Bytes of the image that were read for it.
    """

    encoding: str
    width_px: int
    height_px: int
    channels: int
    num_bytes: int

    @property
    def text(self) -> str:
        """In words."""
        return f"{self.encoding} of {self.width_px} x {self.height_px} px, {CHANNELS[self.channels]}"


def read_header(content: bytes) -> ImageHeader:
    """Header of an encoded image.

    Raises:
        DecodeError: It is no image of a known form; the message says what it is.
    """
    start = content[:8]
    try:
        if start == SIGNATURES["png"]:
            return _png_header(content)
        if start.startswith(SIGNATURES["jpeg"]):
            return _jpeg_header(content)
    except struct.error:
        raise DecodeError("a header that ends early") from None
    raise DecodeError(f"no image of a known encoding: it begins with {start.hex() or 'nothing'}")


def is_whole(content: bytes, encoding: str) -> bool:
    """Whether an image ends as its encoding demands; every part of a PNG has the checksum that it names, too."""
    if encoding == "jpeg":
        return content.endswith(_JPEG_END)
    chunks = [kind for kind, _ in png_chunks(content)]
    return chunks.count(b"IEND") == 1 and chunks[-1] == b"IEND" and content.endswith(_PNG_END)


def png_chunks(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and body of the chunks of a PNG, up to the first that is cut short or has another checksum, or the end."""
    place = len(SIGNATURES["png"])
    while place + 12 <= len(content):
        length, kind = struct.unpack_from(">I4s", content, place)
        stop = place + 8 + length
        if stop + 4 > len(content) or content[stop : stop + 4] != crc32(content[place + 4 : stop]).to_bytes(4, "big"):
            return
        yield kind, content[place + 8 : stop]
        place = stop + 4


def _png_header(content: bytes) -> ImageHeader:
    length, kind, width, height, depth, colour, compression, method, interlace = _PNG_HEADER.unpack_from(content, 8)
    if (length, kind) != (13, b"IHDR"):
        raise DecodeError("a png without a header")
    if depth != 8 or colour not in _PNG_CHANNELS or compression or method or interlace:
        raise DecodeError(f"a png of {depth} bits, colour type {colour}, interlacing {interlace}")
    return ImageHeader("png", width, height, _PNG_CHANNELS[colour], 8 + _PNG_HEADER.size)


def _jpeg_header(content: bytes) -> ImageHeader:
    place = 2
    for _ in range(_MAX_SEGMENTS):
        mark, code, length = struct.unpack_from(">BBH", content, place)
        if mark != 0xFF or code in (_SCAN, _END) or length < 2:
            raise DecodeError("a jpeg without a frame header")
        if code in _FRAMES:
            depth, height, width, channels = struct.unpack_from(">BHHB", content, place + 4)
            if depth != 8 or channels != 3:
                raise DecodeError(f"a jpeg of {depth} bits and {channels} channels")
            return ImageHeader("jpeg", width, height, channels, place + 2 + length)
        if code in _OTHER_FRAMES:
            raise DecodeError(f"a jpeg that is neither baseline nor progressive (marker ff{code:02x})")
        place += 2 + length
    raise DecodeError(f"a jpeg without a frame header among its first {_MAX_SEGMENTS} segments")
