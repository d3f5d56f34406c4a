"""Angles on the circle."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["wrap_rad"]


def wrap_rad(angle_rad: ArrayLike) -> NDArray[np.float64]:
    """The angle in ``[-pi, pi]`` that points the same way, of any shape; odd, and exact where nothing is wrapped."""
    angle = np.asarray(angle_rad, np.float64)
    return np.asarray(angle - 2 * np.pi * np.rint(angle / (2 * np.pi)))
