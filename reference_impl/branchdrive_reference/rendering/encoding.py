"""Images as bytes: JPEG for what a camera sees, PNG for a semantic view, whose values must not change."""

from __future__ import annotations

from branchdrive_reference.rendering.opencv import Image, cv2

__all__ = ["JPEG_QUALITY", "encoded", "encoding_of"]

JPEG_QUALITY = 75

_PNG_LEVEL = 6


def encoding_of(image: Image) -> str:
    """How an image is encoded, as the media index names it."""
    return "png" if image.ndim == 2 else "jpeg"


def encoded(image: Image) -> bytes:
    """An image of a camera ``[height, width, 3]`` or a semantic view ``[height, width]`` as bytes."""
    if encoding_of(image) == "png":
        suffix, options = ".png", [cv2.IMWRITE_PNG_COMPRESSION, _PNG_LEVEL]
    else:
        suffix, options = ".jpg", [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
    return bytes(cv2.imencode(suffix, image, options)[1])
