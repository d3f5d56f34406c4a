"""What a media index says of images, each thing once: a million rows may name one range of one file.

Rows that say the same of the same bytes are one claim, and claims about the same bytes lie at one place. Bytes are read
once for a place, and judged once for a claim.

Source: spec/05-raw-streams.md#media.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.camera import Camera
from branchdrive.contract.columns import PATTERNS
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.semantic_bev import SEMANTIC_STREAM
from branchdrive.contract.text import quote
from branchdrive.tables.view import TableView

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Claim", "ImageClaims", "ImageKey", "Place"]

Index = NDArray[np.int64]

_FILE_NAME = re.compile(PATTERNS["file"].removeprefix("^").removesuffix("$"))
_TEXTS = ("file", "camera", "encoding", "checksum", "rollout_id")
_NUMBERS = ("offset_bytes", "size_bytes", "tick")


class Claim(NamedTuple):
    """What rows of an index say of the bytes at a place.

    Attributes:
        camera: Camera of the image.
        encoding: How it is encoded.
        checksum: What its bytes are known by.
        rows: The stored rows that say so, ascending.
    """

    camera: str
    encoding: str
    checksum: str
    rows: Index


class Place(NamedTuple):
    """A range of a file that rows name.

    Attributes:
        offset: First byte.
        size: Number of bytes.
        claims: What is said of them.
    """

    offset: int
    size: int
    claims: list[Claim]


class ImageKey(NamedTuple):
    """Which image a row is about."""

    rollout_id: str
    tick: int
    camera: str


class ImageClaims:
    """Claims of a media index, file by file; rows with nulls or unsafe names are reported by other rules.

    Args:
        frames: The index with the declared columns.

    Attributes:
        num_rows: Rows of every file that is named ``{name: rows}``.
    """

    def __init__(self, frames: pa.Table) -> None:
        view = TableView("frames", frames)
        self._names: dict[str, list[str]] = {}
        self._codes: dict[str, NDArray[np.int32]] = {}
        for column in _TEXTS:
            self._names[column], self._codes[column] = _distinct(*view.categories(column))
        self._offset, self._size, self._tick = (view[column] for column in _NUMBERS)
        is_safe = np.array([_FILE_NAME.fullmatch(name) is not None for name in self._names["file"]] + [False])
        is_whole = is_safe[self._codes["file"]]
        for column in (*_TEXTS, *_NUMBERS):
            is_whole &= view.valid(column)
        own = np.flatnonzero(is_whole)
        of_place = [self._codes["file"], self._offset, self._size]
        of_claim = [self._codes[column] for column in ("camera", "encoding", "checksum")]
        order = own[np.lexsort([values[own] for values in (*of_claim[::-1], *of_place[::-1])])]
        self._rows = order
        begins_file, begins_place, begins_image, begins_claim = (
            _begins([values[order] for values in keys])
            for keys in (of_place[:1], of_place, [*of_place, of_claim[0]], [*of_place, *of_claim])
        )
        self._claim = np.append(np.flatnonzero(begins_claim), len(order))
        self._place = np.append(np.flatnonzero(begins_place), len(order))
        self._image = np.flatnonzero(begins_image)
        files = np.append(np.flatnonzero(begins_file), len(order)).tolist()
        self._span = {
            self._names["file"][self._codes["file"][order[start]]]: (start, stop) for start, stop in pairwise(files)
        }
        self.num_rows = {name: stop - start for name, (start, stop) in self._span.items()}

    def key(self, row: int) -> ImageKey:
        """Which image a stored row is about."""
        return ImageKey(self._text("rollout_id", row), int(self._tick[row]), self._text("camera", row))

    def excess(self, cameras: Mapping[str, Camera]) -> str | None:
        """How the index exceeds the limits on rows of a range and on pixels; ``None`` where it does not."""
        limits, begins = spec_limits(), self._place[:-1]
        if not len(begins):
            return None
        is_map = self._by_camera({name: camera.stream == SEMANTIC_STREAM for name, camera in cameras.items()})
        num_rows, has_map = np.diff(self._place), np.maximum.reduceat(is_map, begins) > 0
        most = np.where(has_map, 1, limits.max_range_rows)
        for at in np.flatnonzero(num_rows > most)[:1].tolist():
            row = int(self._rows[begins[at]])
            where = f"{self._size[row]} bytes from {self._offset[row]} of {quote(self._text('file', row))}"
            kind = ", a semantic map," if has_map[at] else ""
            return f"names {where}{kind} in {num_rows[at]:,} rows; the limit is {most[at]}"
        pixels = self._by_camera({name: camera.width_px * camera.height_px for name, camera in cameras.items()})
        num_pixels = int(pixels[self._image].sum())
        if num_pixels > limits.max_shard_pixels:
            return f"names images of {num_pixels:,} pixels; the limit is {limits.max_shard_pixels:,}"
        return None

    def num_bytes(self, file: str, size: int) -> int:
        """Bytes of a file of some size in the ranges that rows name, equal ranges counted once."""
        first, last = np.searchsorted(self._place, self._span.get(file, (0, 0)))
        rows = self._rows[self._place[first:last]]
        offset = self._offset[rows]
        inside = np.clip(np.minimum(self._size[rows], size - offset), 0, None)
        return int(inside[offset >= 0].sum())

    def places(self, file: str) -> Iterator[Place]:
        """Places in a file, by offset and size."""
        first, last = np.searchsorted(self._place, self._span.get(file, (0, 0))).tolist()
        claim = int(np.searchsorted(self._claim, self._place[first]))
        for stop in self._place[first + 1 : last + 1].tolist():
            claims = []
            while (start := int(self._claim[claim])) < stop:
                claim += 1
                rows = self._rows[start : self._claim[claim]]
                row = int(rows[0])
                camera, encoding, checksum = (self._text(column, row) for column in _TEXTS[1:4])
                claims.append(Claim(camera, encoding, checksum, rows))
            row = int(claims[0].rows[0])
            yield Place(int(self._offset[row]), int(self._size[row]), claims)

    def _text(self, column: str, row: int) -> str:
        return self._names[column][int(self._codes[column][row])]

    def _by_camera(self, values: Mapping[str, int]) -> Index:
        """A value of the camera of each row, in the order of places; 0 where it is not declared."""
        by_code = np.array([values.get(name, 0) for name in self._names["camera"]] + [0], np.int64)
        return by_code[self._codes["camera"][self._rows]]


def _distinct(codes: NDArray[np.int32], names: list[str]) -> tuple[list[str], NDArray[np.int32]]:
    """Distinct names in ascending order and their codes ``[rows]``, -1 where null; files may repeat names."""
    distinct = sorted(set(names))
    place = {name: code for code, name in enumerate(distinct)}
    return distinct, np.array([place[name] for name in names] + [-1], np.int32)[codes]


def _begins(keys: list[NDArray[Any]]) -> NDArray[np.bool_]:
    """Where runs of equal keys begin ``[rows]``."""
    begins = np.ones(len(keys[0]), bool)
    begins[1:] = np.logical_or.reduce([key[1:] != key[:-1] for key in keys])
    return begins
