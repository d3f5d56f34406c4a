"""Headers of PNG and JPEG images: what an image is, without decoding it.

Sources: PNG, third edition, 5.2 and 11.2.1 (https://www.w3.org/TR/png-3/); ITU-T T.81, B.1 and B.2.2.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from itertools import islice
from typing import Literal

from branchdrive.contract.camera import Camera
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.semantic_bev import SEMANTIC_STREAM
from branchdrive.errors import DecodeError
from branchdrive.formats.image_parts import FRAMES, JPEG_START, PNG_SIGNATURE, find_flaw, jpeg_segments

__all__ = ["ImageHeader", "disagreement", "image_header", "read_header"]

_PNG_COLOURS = {0: "grey", 2: "rgb", 3: "palette", 4: "grey with alpha", 6: "rgb with alpha"}

_JPEG_COLOURS = {1: "grey", 3: "rgb", 4: "cmyk"}
_CODINGS = frozenset({0xC0, 0xC2})
"""Markers of the frames that every decoder reads: baseline and progressive."""


@dataclass(frozen=True)
class ImageHeader:
    """What the header of an image says.

    Attributes:
        encoding: How it is encoded, as the media index names it.
        width_px: Columns.
        height_px: Rows.
        colour: ``grey``, ``rgb``, or what no image of a dataset may be.
        bit_depth: Bits of a channel.
        coding: How it is coded, where no image of a dataset may be; empty otherwise.
        num_bytes: Bytes of the image that say so.
    """

    encoding: Literal["jpeg", "png"]
    width_px: int
    height_px: int
    colour: str
    bit_depth: int
    coding: str = ""
    num_bytes: int = field(default=0, compare=False)

    def __str__(self) -> str:
        kind = [self.encoding.upper(), self.colour, f"{self.bit_depth} bits", *([self.coding] if self.coding else [])]
        return f"{self.width_px} x {self.height_px} pixels ({', '.join(kind)})"


def image_header(image: bytes | memoryview) -> ImageHeader:
    """Header of an encoded image that has no flaw.

    Raises:
        DecodeError: The bytes are no PNG or JPEG, are cut off, or hold what no image of a dataset may.
    """
    image = bytes(image)
    header = read_header(image)
    if (flaw := find_flaw(image, header.encoding)) is not None:
        raise DecodeError(f"{flaw.found}; expected {flaw.expected}")
    return header


def read_header(image: bytes) -> ImageHeader:
    """Header of an encoded image, whatever follows it.

    Raises:
        DecodeError: The bytes are no PNG or JPEG, or their header is cut off.
    """
    if image.startswith(PNG_SIGNATURE):
        return _png(image)
    if image.startswith(JPEG_START):
        return _jpeg(image)
    raise DecodeError(f"neither a PNG nor a JPEG: {len(image)} bytes that begin with {image[:8]!r}")


def _png(image: bytes) -> ImageHeader:
    if len(image) < 33 or image[8:16] != b"\x00\x00\x00\rIHDR":
        raise DecodeError("a PNG without its header")
    width, height, bit_depth, colour, *methods, interlacing = struct.unpack_from(">IIBBBBB", image, 16)
    name = _PNG_COLOURS.get(colour, f"colour type {colour}")
    coding = "with unknown methods" if any(methods) else "interlaced" if interlacing else ""
    return ImageHeader("png", width, height, name, bit_depth, coding, 29)


def _jpeg(image: bytes) -> ImageHeader:
    for marker, start, stop in islice(jpeg_segments(image), spec_limits().max_image_parts):
        if marker in FRAMES and stop - start >= 10:
            bit_depth, height, width, channels = struct.unpack_from(">BHHB", image, start + 4)
            name = _JPEG_COLOURS.get(channels, f"{channels} channels")
            coding = "" if marker in _CODINGS else f"neither baseline nor progressive (ff{marker:02x})"
            return ImageHeader("jpeg", width, height, name, bit_depth, coding, start + 10)
        if marker in (0xD9, 0xDA):  # the end, or pixels, before any frame
            break
    raise DecodeError("a JPEG without the header of a frame")


def disagreement(header: ImageHeader, camera: Camera) -> str | None:
    """What keeps an image from being one of the camera, as what was expected; ``None`` if nothing does."""
    if (header.width_px, header.height_px) != (camera.width_px, camera.height_px):
        return f"{camera.width_px} x {camera.height_px} pixels, as camera `{camera.name}` is declared"
    if header.coding:
        return "a PNG without interlacing" if header.encoding == "png" else "a JPEG that is baseline or progressive"
    if camera.stream == SEMANTIC_STREAM:
        is_fit = (header.encoding, header.colour, header.bit_depth) == ("png", "grey", 8)
        return None if is_fit else "a PNG of one channel of 8 bits"
    return None if (header.colour, header.bit_depth) == ("rgb", 8) else "three channels of 8 bits"
