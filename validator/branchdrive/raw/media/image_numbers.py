"""Numbers that stand for the pixels of an image: how bright the cells of a grid are, and where in them it is bright.

With ``v_{ij}`` the sum of the channels of the pixel in row ``i`` and column ``j`` of a cell of ``m`` rows and ``n``
columns, both from 0, and ``c`` channels::

    mean    sum v_{ij} / (m n c)
    down    sum v_{ij} (2 i - m + 1) / (m n c)        above 0 where the lower half is brighter
    right   sum v_{ij} (2 j - n + 1) / (m n c)        above 0 where the right half is brighter

Sums are of whole numbers, so each number is rounded once, by its division, and then to float32.

Source: this project's choice; spec/13-leakage.md#streams.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["NAMES", "image_numbers"]

_GRID = 4
"""Rows and columns of the grid."""

_KINDS = ("", " down", " right")

NAMES = tuple(f"{row}.{column}{kind}" for kind in _KINDS for row, column in np.ndindex(_GRID, _GRID))
"""What the numbers of an image are called: means of the cells row by row, then their moments down and right."""


def image_numbers(pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Numbers of an image of shape ``[rows, columns]`` or ``[rows, columns, channels]``, in the order of `NAMES`.

    An image with fewer rows or columns than the grid is one cell, whose numbers stand in all cells.
    """
    height, width = pixels.shape[:2]
    values = pixels.reshape(height, -1)
    num_channels = values.shape[1] // width
    size = _GRID if min(height, width) >= _GRID else 1
    tops, lefts = (np.arange(size + 1) * extent // size for extent in (height, width))
    by_row = np.add.reduceat(values, lefts[:-1] * num_channels, axis=1, dtype=np.uint32)
    by_column = np.add.reduceat(values, tops[:-1], axis=0, dtype=np.uint32)
    by_column = by_column.reshape(size, width, num_channels).sum(axis=2)
    sums = [
        np.add.reduceat(by_row, tops[:-1], axis=0, dtype=np.int64),
        np.add.reduceat(by_row * _weights(tops)[:, None], tops[:-1], axis=0),
        np.add.reduceat(by_column * _weights(lefts), lefts[:-1], axis=1),
    ]
    num_values = np.outer(np.diff(tops), np.diff(lefts)) * num_channels
    cells = np.asarray(np.stack(sums) / num_values, np.float32)
    return np.broadcast_to(cells, (len(_KINDS), _GRID, _GRID)).ravel()


def _weights(starts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Twice the distance of a row or column from the middle of its cell ``[rows or columns]``."""
    sizes = np.diff(starts)
    return np.concatenate([2 * np.arange(size) - size + 1 for size in sizes.tolist()])
