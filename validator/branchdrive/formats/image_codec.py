"""Decoding of images, with Pillow or OpenCV: whichever the extra `media` has put there."""

from __future__ import annotations

import zlib
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.errors import DecodeError, PlatformError
from branchdrive.formats.image_header import ImageHeader, image_header
from branchdrive.formats.image_parts import pixel_parts, png_data

__all__ = ["NO_DECODER", "can_decode", "decode_image", "decoder"]

NO_DECODER = "decoding images needs Pillow or OpenCV, which the extra `media` brings"
"""What is said where neither library is there."""


def can_decode() -> bool:
    """Whether a library that decodes images is there."""
    return decoder() is not None


def decoder() -> str | None:
    """Name and version of the library that decodes images here; ``None`` where there is none.

    Two of them may decode one JPEG to other pixels, by a level or two; a PNG has the same pixels in all.
    """
    if (pillow := _pillow()) is not None:
        return f"Pillow {pillow.__version__}"
    return None if (cv2 := _opencv()) is None else f"OpenCV {cv2.__version__}"


def decode_image(image: bytes) -> NDArray[np.uint8]:
    """Pixels of a JPEG or PNG with channels of 8 bits: ``[height, width, 3]`` of RGB, ``[height, width]`` of grey.

    The orientation that a JPEG may name is not applied. Memory follows from the size in the header: look at
    `image_header` before decoding what is not trusted.

    Raises:
        DecodeError: The bytes are no such image, or are damaged.
        PlatformError: Neither Pillow nor OpenCV is there.
    """
    header = image_header(image)
    if header.colour not in ("grey", "rgb") or header.bit_depth != 8 or header.coding:
        raise DecodeError(f"neither grey nor RGB of 8 bits: {header}")
    if header.encoding == "png":
        _demand_all_rows(image, header)
    image = pixel_parts(image, header.encoding)
    pillow = _pillow()
    pixels = _with_opencv(image) if pillow is None else _with_pillow(pillow, image)
    expected = (header.height_px, header.width_px) + ((3,) if header.colour == "rgb" else ())
    if pixels.shape != expected:
        raise DecodeError(f"decodes to {list(pixels.shape)} values; its header says {header}")
    return pixels


def _demand_all_rows(image: bytes, header: ImageHeader) -> None:
    """Let an image end here whose rows are not as many as its header says; decoders take missing ones for black.

    Raises:
        DecodeError: They are not, or cannot be unpacked.
    """
    wanted = header.height_px * (1 + header.width_px * (3 if header.colour == "rgb" else 1))
    stream = zlib.decompressobj()
    try:
        num_bytes = len(stream.decompress(png_data(image), wanted + 1))
    except (zlib.error, OverflowError) as error:
        raise DecodeError("a PNG whose data are damaged: they cannot be unpacked") from error
    if num_bytes != wanted or not stream.eof:
        raise DecodeError(f"a PNG with {'fewer' if num_bytes < wanted else 'more'} rows than its header says")
    if stream.unused_data:
        raise DecodeError(f"a PNG with {len(stream.unused_data):,} bytes behind its rows")


def _pillow() -> Any:
    try:
        from PIL import Image
    except ModuleNotFoundError:
        return None
    return Image


def _opencv() -> Any:
    try:
        import cv2
    except ModuleNotFoundError:
        return None
    return cv2


def _with_pillow(pillow: Any, image: bytes) -> NDArray[np.uint8]:
    try:
        with pillow.open(BytesIO(image), formats=("PNG", "JPEG")) as opened:
            return np.array(opened, np.uint8)
    except Exception as error:  # decoders of damaged bytes raise whatever they stumble over
        raise DecodeError(f"cannot be decoded ({error})") from error


def _with_opencv(image: bytes) -> NDArray[np.uint8]:
    cv2 = _opencv()
    if cv2 is None:
        raise PlatformError(NO_DECODER)
    pixels = cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise DecodeError("cannot be decoded (OpenCV)")
    return np.ascontiguousarray(pixels[..., ::-1] if pixels.ndim == 3 else pixels)
