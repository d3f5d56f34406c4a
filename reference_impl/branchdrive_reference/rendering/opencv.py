"""The one door to OpenCV: one thread, so that equal inputs give equal bytes wherever they are drawn."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["OPENCV_VERSION", "SUBPIXEL_BITS", "Image", "cv2", "fixed_point"]

cv2.setNumThreads(1)
cv2.ocl.setUseOpenCL(False)

OPENCV_VERSION: str = cv2.__version__
"""Versions draw and encode alike, but promise no equal bytes."""

Image = NDArray[np.uint8]
"""Rows from above, ``[height, width, 3]`` in the order blue, green, red, or ``[height, width]``."""

SUBPIXEL_BITS = 4
"""Bits of a pixel's fraction in the coordinates of `fixed_point`."""

_LARGEST_PX = 16384.0
"""Drawing clips what lies outside of an image; farther outside its integers would overflow."""


def fixed_point(points_px: NDArray[np.float64]) -> NDArray[np.int32]:
    """Pixel coordinates ``[.., 2]`` as drawing functions take them with the shift `SUBPIXEL_BITS`.

    The centre of pixel (0, 0) lies at (0.5, 0.5) here, and at (0, 0) for OpenCV.
    """
    within = np.minimum(np.maximum(points_px, -_LARGEST_PX), _LARGEST_PX)  # a third of the time of clip on a few points
    scaled = (within - 0.5) * (1 << SUBPIXEL_BITS)
    return np.rint(scaled).astype(np.int32, order="C")
