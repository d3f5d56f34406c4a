"""Headers of PNG and JPEG images: what an image is, without decoding it.

Sources: PNG, third edition, 5.2 and 11.2.1 (https://www.w3.org/TR/png-3/); ITU-T T.81, B.1 and B.2.2.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal
from zlib import crc32

from branchdrive.contract.camera import Camera
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.semantic_bev import SEMANTIC_STREAM
from branchdrive.errors import DecodeError

__all__ = ["ImageHeader", "disagreement", "excess", "image_header", "is_whole", "png_chunks", "read_header"]

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PNG_END = b"\x00\x00\x00\x00IEND\xaeB`\x82"
_PNG_COLOURS = {0: "grey", 2: "rgb", 3: "palette", 4: "grey with alpha", 6: "rgb with alpha"}

_JPEG_START, _JPEG_SCAN, _JPEG_END = b"\xff\xd8", b"\xff\xda", b"\xff\xd9"
_JPEG_COLOURS = {1: "grey", 3: "rgb", 4: "cmyk"}
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG that begin a frame, which has the size."""

_CODINGS = frozenset({0xC0, 0xC2})
"""Those of them that every decoder reads: baseline and progressive."""

_BARE = frozenset({0x01, *range(0xD0, 0xD8)})
"""Markers of JPEG that no length follows."""


@dataclass(frozen=True)
class ImageHeader:
    """What the header of an image says.

    Attributes:
        encoding: How it is encoded, as the media index names it.
        width_px: Columns.
        height_px: Rows.
        colour: ``grey``, ``rgb``, or what no image of a dataset may be.
        bit_depth: Bits of a channel.
        num_bytes: Bytes of the image that say so.
    """

    encoding: Literal["jpeg", "png"]
    width_px: int
    height_px: int
    colour: str
    bit_depth: int
    num_bytes: int = field(default=0, compare=False)

    def __str__(self) -> str:
        kind = f"{self.encoding.upper()}, {self.colour}, {self.bit_depth} bits"
        return f"{self.width_px} x {self.height_px} pixels ({kind})"


def image_header(image: bytes | memoryview) -> ImageHeader:
    """Header of an encoded image that has an end and nothing in excess.

    Raises:
        DecodeError: The bytes are no PNG or JPEG, are cut off, or hold what no image of a dataset may.
    """
    image = bytes(image)
    header = read_header(image)
    if not _has_end(image, header.encoding):
        raise DecodeError(f"a {header.encoding.upper()} that is cut off")
    if (found := excess(image, header.encoding)) is not None:
        raise DecodeError(f"{found[1]}; expected {found[0]}")
    return header


def read_header(image: bytes) -> ImageHeader:
    """Header of an encoded image, whatever follows it.

    Raises:
        DecodeError: The bytes are no PNG or JPEG, or their header is cut off.
    """
    if image.startswith(_PNG_SIGNATURE):
        return _png(image)
    if image.startswith(_JPEG_START):
        return _jpeg(image)
    raise DecodeError(f"neither a PNG nor a JPEG: {len(image)} bytes that begin with {image[:8]!r}")


def is_whole(image: bytes, encoding: str) -> bool:
    """Whether an image ends as its encoding demands, and every part of a PNG has the checksum that it names."""
    if encoding == "jpeg":
        return _has_end(image, encoding)
    kinds = [kind for kind, _ in png_chunks(image)]
    return kinds.count(b"IEND") == 1 and kinds[-1] == b"IEND" and _has_end(image, encoding)


def excess(image: bytes, encoding: str) -> tuple[str, str] | None:
    """Expected and found text of what an image holds beside its header and may not; ``None`` if nothing.

    Every scan of a JPEG costs a decoder a pass over all pixels, whatever its length. In the data of a scan no
    ff is followed by da, so that markers are counted without being parsed; notes that hold such bytes count too.
    A chunk `tRNS` makes a fourth channel of a colour, which some decoders give and others do not.
    """
    limit = spec_limits().max_image_scans
    if encoding == "jpeg" and (num_scans := image.count(_JPEG_SCAN)) > limit:
        return f"a JPEG of at most {limit} scans", f"one with {num_scans:,} markers of a scan"
    if encoding == "png" and b"tRNS" in image and any(kind == b"tRNS" for kind, _ in png_chunks(image)):
        return "a PNG without transparency", "one with a chunk `tRNS`"
    return None


def png_chunks(image: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and body of the chunks of a PNG, up to the first that is cut short or has another checksum."""
    place = len(_PNG_SIGNATURE)
    while place + 12 <= len(image):
        length, kind = struct.unpack_from(">I4s", image, place)
        stop = place + 8 + length
        if stop + 4 > len(image) or image[stop : stop + 4] != crc32(image[place + 4 : stop]).to_bytes(4, "big"):
            return
        yield kind, image[place + 8 : stop]
        place = stop + 4


def _has_end(image: bytes, encoding: str) -> bool:
    if encoding == "png":
        return image.endswith(_PNG_END)
    return image.endswith(_JPEG_END) or image.rstrip(b"\x00").endswith(_JPEG_END)


def _png(image: bytes) -> ImageHeader:
    if len(image) < 33 or image[8:16] != b"\x00\x00\x00\rIHDR":
        raise DecodeError("a PNG without its header")
    width, height, bit_depth, colour, _, _, interlacing = struct.unpack_from(">IIBBBBB", image, 16)
    name = _PNG_COLOURS.get(colour, f"colour type {colour}") + (", interlaced" if interlacing else "")
    return ImageHeader("png", width, height, name, bit_depth, 29)


def _jpeg(image: bytes) -> ImageHeader:
    position = len(_JPEG_START)
    while position + 4 <= len(image) and image[position] == 0xFF:
        marker = image[position + 1]
        if marker == 0xFF or marker in _BARE:  # a fill byte, or a marker alone
            position += 1 if marker == 0xFF else 2
            continue
        (length,) = struct.unpack_from(">H", image, position + 2)
        if marker in _FRAMES and position + 10 <= len(image):
            bit_depth, height, width, channels = struct.unpack_from(">BHHB", image, position + 4)
            name = _JPEG_COLOURS.get(channels, f"{channels} channels")
            name += "" if marker in _CODINGS else f", neither baseline nor progressive (ff{marker:02x})"
            return ImageHeader("jpeg", width, height, name, bit_depth, position + 10)
        if length < 2 or marker in (0xD9, 0xDA):  # the end, or pixels, before any frame
            break
        position += 2 + length
    raise DecodeError("a JPEG without the header of a frame")


def disagreement(header: ImageHeader, camera: Camera) -> str | None:
    """What keeps an image from being one of the camera, as what was expected; ``None`` if nothing does."""
    if (header.width_px, header.height_px) != (camera.width_px, camera.height_px):
        return f"{camera.width_px} x {camera.height_px} pixels, as camera `{camera.name}` is declared"
    if camera.stream == SEMANTIC_STREAM:
        is_fit = (header.encoding, header.colour, header.bit_depth) == ("png", "grey", 8)
        return None if is_fit else "a PNG of one channel of 8 bits"
    return None if (header.colour, header.bit_depth) == ("rgb", 8) else "three channels of 8 bits"
