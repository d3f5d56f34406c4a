"""Joins of rows on a key of whole numbers: packed into one number, sorted once, and looked up many at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["KeyIndex", "find_sorted"]

Index = NDArray[np.int64]

_MAX_CODE = 2**62


def find_sorted(keys: NDArray[Any], wanted: NDArray[Any]) -> Index:
    """Place of the first of ascending `keys` that is each of `wanted`, of whose shape it is; -1 where there is none."""
    if not len(keys):
        return np.full(np.shape(wanted), -1)
    place = np.searchsorted(keys, wanted)
    return np.where(keys.take(place, mode="clip") == wanted, place, -1)


class KeyIndex:
    """Rows by the parts of their key.

    A key is packed as ``((p_0 - low_0) w_1 + p_1 - low_1) w_2 + ..``, with ``w`` the width of a part's range. Where
    that is too large for 62 bits, the number so far, or the part, is replaced by its place among those that there are.

    Args:
        parts: Columns of whole numbers ``[rows]``.
    """

    def __init__(self, *parts: NDArray[Any]) -> None:
        self._steps: list[tuple[Index | None, Index | None, int, int]] = []
        code, num_codes = np.zeros(1, np.int64), 1
        for part in parts:
            values = part.astype(np.int64, copy=False)
            low, width = (int(values.min()), int(values.max()) - int(values.min()) + 1) if len(values) else (0, 1)
            codes, known = None, None
            if num_codes * width > _MAX_CODE:
                codes, code = np.unique(code, return_inverse=True)
                num_codes = len(codes)
            if num_codes * width > _MAX_CODE:
                known, values = np.unique(values, return_inverse=True)
                low, width = 0, len(known)
            self._steps.append((codes, known, low, width))
            code, num_codes = code * width + (values - low if low else values), num_codes * width
        is_sorted = bool((code[1:] >= code[:-1]).all())
        self._order = None if is_sorted else np.argsort(code, kind="stable")
        self._codes = code if self._order is None else code[self._order]

    def find(self, *parts: NDArray[Any] | int) -> Index:
        """The first row with each key, -1 where there is none, of the shape that the parts share."""
        return self._rows(find_sorted(self._codes, self._code(parts)))

    def last_before(self, *parts: NDArray[Any]) -> Index:
        """The last row with each key but a smaller last part, -1 where there is none, of the shape of the parts."""
        *others, last = parts
        _, known, low, width = self._steps[-1]
        before = (last if known is None else np.searchsorted(known, last)) - low
        first = self._code([*others, low if known is None else int(known[0])])
        place = np.searchsorted(self._codes, first + np.clip(before, 0, width)) - 1
        is_there = (first >= 0) & (place >= 0) & (self._codes.take(place, mode="clip") >= first)
        return self._rows(np.where(is_there, place, -1))

    def _code(self, parts: Sequence[NDArray[Any] | int]) -> Index:
        """Packed keys; -1 where a part is none of those that there are."""
        code, is_known = np.zeros(1, np.int64), np.ones(1, bool)
        for part, (codes, known, low, width) in zip(map(np.asarray, parts), self._steps, strict=True):
            if codes is not None:
                code = find_sorted(codes, code)
                is_known = is_known & (code >= 0)
            values = part.astype(np.int64, copy=False) - low if known is None else find_sorted(known, part)
            # One comparison for both ends: a number below 0 is a large one without a sign.
            code, is_known = code * width + values, is_known & (values.view(np.uint64) < width)
        return np.where(is_known, code, -1)

    def _rows(self, place: Index) -> Index:
        if self._order is None:
            return place
        return np.where(place >= 0, self._order[place], -1)
