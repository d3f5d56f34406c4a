"""Small images as files, written without a library: PNGs of grey and RGB pixels, and JPEGs by Pillow."""

from __future__ import annotations

import struct
import zlib
from io import BytesIO

import numpy as np
from numpy.typing import NDArray


def png(pixels: NDArray[np.uint8], note: bytes = b"") -> bytes:
    """A PNG of grey ``[height, width]`` or RGB ``[height, width, 3]`` pixels, with a note in a chunk of its own."""
    height, width = pixels.shape[:2]
    header = struct.pack(">IIBBBBB", width, height, 8, 0 if pixels.ndim == 2 else 2, 0, 0, 0)
    rows = b"".join(b"\x00" + row.tobytes() for row in pixels)
    notes = ((b"teXt", note),) if note else ()
    chunks = ((b"IHDR", header), *notes, (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )


def noise(seed: int, *shape: int) -> NDArray[np.uint8]:
    """Pixels of a shape, drawn with a seed."""
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


def jpeg(pixels: NDArray[np.uint8], **options: object) -> bytes:
    """A JPEG of grey or RGB pixels."""
    from PIL import Image

    stream = BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", **options)
    return stream.getvalue()
