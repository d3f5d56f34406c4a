"""Frames: the rows of one table as numpy columns, and how rows of two frames with the same key are paired.

A frame is a plain mapping from column names to arrays of one length. Text is an array of objects, a
column with masked entries is a masked array, and a list column holds an array in every cell.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from branchdrive.tables.join import KeyIndex

__all__ = [
    "Alignment", "Frame", "align", "concat", "distinct", "num_rows", "of_groups", "repeated_rows", "sort_rows", "take",
    "with_homes",
]  # fmt: skip

Values: TypeAlias = "NDArray[Any] | np.ma.MaskedArray[Any, Any]"
Frame: TypeAlias = Mapping[str, Values]
Index = NDArray[np.int64]

_MAX_CODE = 2**62
"""Codes of the columns of a key are joined up to here without being counted again."""


class Alignment(NamedTuple):
    """Pairs of rows of two frames with equal keys.

    Attributes:
        expected: Rows of the first that have a partner ``[pairs]``.
        found: Their partners in the second ``[pairs]``.
        missing: Rows of the first without a partner.
        extra: Rows of the second without a partner, and all but the first of rows with one key.
    """

    expected: Index
    found: Index
    missing: Index
    extra: Index


def num_rows(frame: Frame) -> int:
    """Number of rows; 0 without columns."""
    return next((len(values) for values in frame.values()), 0)


def take(frame: Frame, rows: NDArray[Any] | slice) -> dict[str, Values]:
    """Rows by index, mask or range, in that order."""
    return {name: values[rows] for name, values in frame.items()}


def of_groups(frame: Frame, groups: Collection[str]) -> dict[str, Values]:
    """Rows of `groups`, in the order of the frame."""
    wanted = set(groups)
    return take(frame, np.array([group in wanted for group in frame["group_id"].tolist()], bool))


def distinct(parts: Sequence[Sequence[str]]) -> list[str]:
    """Identities of all parts, one after the other.

    Raises:
        ValueError: Two are equal.
    """
    found = [name for part in parts for name in part]
    if len({*found}) < len(found):
        raise ValueError("an identity is in two parts, or twice in one")
    return found


def with_homes(frame: Frame, homes: Mapping[str, str]) -> dict[str, Values]:
    """Rows of the groups that have a home, in the order of the frame, with the column `partition`.

    Args:
        frame: Rows with a `group_id`.
        homes: Partition of each group.
    """
    rows = of_groups(frame, homes)
    return {**rows, "partition": np.array([homes[group] for group in rows["group_id"].tolist()], object)}


def concat(frames: Sequence[Frame]) -> dict[str, Values]:
    """Rows of frames with equal columns, one after the other.

    Raises:
        ValueError: There is no frame, or columns differ.
    """
    if not frames or any(frame.keys() != frames[0].keys() for frame in frames):
        raise ValueError("frames of the same columns, at least one")
    return {name: _joined([frame[name] for frame in frames]) for name in frames[0]}


def _joined(parts: Sequence[Values]) -> Values:
    if any(np.ma.isMaskedArray(part) for part in parts):
        joined: Values = np.ma.concatenate(parts)  # type: ignore[no-untyped-call]
        return joined
    return np.concatenate(parts)


def sort_rows(frame: Frame, key: Sequence[str], orders: Mapping[str, Sequence[str]] | None = None) -> dict[str, Values]:
    """Rows in ascending order of their key; a text column in `orders` follows the order of its categories there."""
    columns = []
    for name in key:
        categories = (orders or {}).get(name)
        values = np.ma.getdata(frame[name])
        if categories is not None:
            place = {category: i for i, category in enumerate(categories)}
            values = np.array([place.get(category, len(place)) for category in values.tolist()], np.int64)
        elif values.dtype == object:
            values = _codes(values)
        columns.append(values)
    return take(frame, np.lexsort(columns[::-1]))


def align(expected: Frame, found: Frame, key: Sequence[str]) -> Alignment:
    """Pair the rows of two frames by the columns of `key`, which are unique in `expected`."""
    both = (expected, found)
    left, right = _key_codes([[np.ma.getdata(frame[name]) for frame in both] for name in key], [*map(num_rows, both)])
    row = KeyIndex(right).find(left)
    is_there = row >= 0
    partner = row[is_there]
    lonely = np.ones(len(right), bool)
    lonely[partner] = False
    return Alignment(np.flatnonzero(is_there), partner, np.flatnonzero(~is_there), np.flatnonzero(lonely))


def repeated_rows(frame: Frame, key: Sequence[str]) -> Index:
    """Rows whose key an earlier row has; a null in a key is equal to a null."""
    (code,) = _key_codes([[np.ma.getdata(frame[name])] for name in key], [num_rows(frame)])
    order = np.argsort(code, kind="stable")
    is_new = np.diff(code[order], prepend=-1) != 0
    return np.sort(order[~is_new])


def _key_codes(columns: Sequence[Sequence[NDArray[Any]]], lengths: Sequence[int]) -> list[Index]:
    """One code of every row, from 0 on, for rows of several parts: equal where all columns of a key are.

    Args:
        columns: Values of each column in each part.
        lengths: Rows of each part.
    """
    code, width = np.zeros(sum(lengths), np.int64), 1
    for parts in columns:
        own = _codes(parts[0] if len(parts) == 1 else np.concatenate(parts))
        own_width = int(own.max(initial=0)) + 1
        if width * own_width > _MAX_CODE:
            code = _codes(code)
            width = int(code.max(initial=0)) + 1
        code, width = code * own_width + own, width * own_width
    return np.split(code, np.cumsum(lengths)[:-1])


def _codes(values: NDArray[Any]) -> Index:
    """Ascending codes of values, from 0 on; null comes before every value."""
    if values.dtype != object:
        return np.unique(values, return_inverse=True)[1].astype(np.int64)
    cells = values.tolist()
    categories = sorted(set(cells) - {None})
    places = {category: i for i, category in enumerate([None, *categories] if None in cells else categories)}
    return np.fromiter(map(places.__getitem__, cells), np.int64, len(cells))
