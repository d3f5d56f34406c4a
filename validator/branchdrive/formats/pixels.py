"""Pixels of encoded images: the one door to the library that decodes them.

An image is decoded as what its header says, by that decoder alone, and only after its size was bounded.
"""

from __future__ import annotations

import zlib
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.errors import DecodeError
from branchdrive.formats.image_header import png_chunks, read_header

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["MISSING_EXTRA", "decode_pixels", "has_decoder"]

MISSING_EXTRA = "images cannot be decoded without Pillow; `pip install 'branchdrive[media]'`"
"""What is said where there is no decoder."""

_FORMATS = {"jpeg": ("JPEG",), "png": ("PNG",)}


def _opener() -> Callable[..., Any] | None:
    try:
        from PIL import Image
    except ImportError:
        return None
    return Image.open


def has_decoder() -> bool:
    """Whether images can be decoded here."""
    return _opener() is not None


def decode_pixels(content: bytes, encoding: str) -> NDArray[np.uint8]:
    """Pixels ``[rows, columns, 3]`` of an image, ``[rows, columns]`` of a grey one.

    Args:
        content: The image, of a form that `image_header.read_header` knows and of bounded size.
        encoding: Its encoding.

    Raises:
        DecodeError: It does not decode to its end, or there is no decoder.
    """
    opener = _opener()
    if opener is None:
        raise DecodeError(MISSING_EXTRA)
    if encoding == "png" and not _has_all_rows(content):
        raise DecodeError("png that holds fewer or more rows than its header says")
    try:
        with opener(BytesIO(content), formats=_FORMATS[encoding]) as image:
            image.load()
            return np.asarray(image)
    except MemoryError:
        raise
    except Exception as error:  # decoders of damaged images raise whatever they come upon
        raise DecodeError(f"{encoding} that does not decode: {str(error) or type(error).__name__}") from error


def _has_all_rows(content: bytes) -> bool:
    """Whether the rows of a whole PNG are as many as its header says; decoders take missing ones for black."""
    header = read_header(content)
    wanted = header.height_px * (1 + header.width_px * header.channels)
    stream = zlib.decompressobj()
    try:
        rows = stream.decompress(b"".join(body for kind, body in png_chunks(content) if kind == b"IDAT"), wanted + 1)
    except zlib.error:
        return False
    return stream.eof and len(rows) == wanted
