"""Numbers of a shard's recorded columns before the branch, for `streams`.

A number stays what it is, a flag is 0 or 1, and a text is its place among the declared ones or, where any text may
stand, a number of 48 bits of its SHA-256. The rows of a moment's actors are summed up in whole steps of ``2^-16``,
exactly and in any order, beside their count: the order in which rows are stored carries no meaning and is not read. An
image is its size and what stands for its pixels; see `image_numbers`. Behind the columns of a table stands how many
different numbers each has in its window: values that repeat change no number of theirs by themselves.

Source: spec/13-leakage.md#streams.
"""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import TABLES, Column
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.leakage.streams import IMAGES, WINDOWS, examined_cameras, num_different, value_columns
from branchdrive.raw.image_index import ImageIndex
from branchdrive.raw.media.image_numbers import NAMES
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import window_rows
from branchdrive.tables.view import StreamView

__all__ = ["camera_numbers", "has_all_images", "recorded_numbers"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_STEPS = 2.0**16
_NULL_OF_ACTOR = -(2.0**20)
_HASHED_BYTES = 6


def recorded_numbers(view: ShardView, attempts: Index) -> Array:
    """Numbers ``[attempts, columns]`` in the order of `stream_columns`, NaN where null or not recorded."""
    tables = [_of_table(view, table, attempts) for table in WINDOWS if table in view]
    return np.concatenate([*tables, camera_numbers(view, attempts)], axis=1)


def camera_numbers(view: ShardView, attempts: Index) -> Array:
    """Numbers of images ``[attempts, columns]`` in the order of `camera_columns`, NaN where there is no sound image."""
    cameras = [_of_camera(view, camera, attempts) for camera in examined_cameras(view.descriptor)]
    return np.concatenate([np.zeros((len(attempts), 0)), *cameras], axis=1)


def has_all_images(view: ShardView) -> bool:
    """Whether the numbers of images are those of all of them."""
    return not examined_cameras(view.descriptor) or (view.images is not None and view.images.unjudged is None)


def _of_camera(view: ShardView, camera: str, attempts: Index) -> Array:
    """Sizes, numbers of pixels and number of different images of a camera ``[attempts, columns]``."""
    found = np.full((len(attempts), len(HISTORY_OFFSETS), 2 + len(NAMES)), np.nan)
    if view.images is not None and IMAGES in view:
        frames = view.stream(IMAGES)
        ticks = view.branch_tick[attempts][:, None] + np.asarray(HISTORY_OFFSETS)
        images = view.cached(ImageIndex)
        code = images.cameras.index(camera) if camera in images.cameras else len(images.cameras)
        rows = images.find(attempts[:, None], code, ticks)
        is_there, rows = rows >= 0, rows[rows >= 0]
        if len(rows):
            found[is_there, 0] = _numbers(frames, TABLES[IMAGES]["size_bytes"], rows)
            found[is_there, 1:-1] = view.images.numbers[frames.position[rows]]
            found[is_there, -1] = _numbers(frames, TABLES[IMAGES]["checksum"], rows)
    of_times = found[..., :-1].transpose(0, 2, 1).reshape(len(attempts), len(HISTORY_OFFSETS) * (1 + len(NAMES)))
    return np.concatenate([of_times, num_different(found[..., -1])[:, None]], axis=1)


def _of_table(view: ShardView, table: str, attempts: Index) -> Array:
    """Numbers of the columns of a table by time, and how many different ones each has ``[attempts, columns]``."""
    stream, offsets = view.stream(table), WINDOWS[table]
    if table == "actors":
        ticks = view.branch_tick[attempts][:, None] + np.asarray(offsets)
        first, stop = stream.span(np.broadcast_to(attempts[:, None], ticks.shape), ticks)
        blocks = [*_sums(stream, first, stop), (stop - first).astype(np.float64)]
    else:
        rows = window_rows(view, stream, attempts, offsets)
        blocks = [np.full(rows.shape, np.nan) for _ in value_columns(table)]
        is_there = rows >= 0
        for block, column in zip(blocks, value_columns(table), strict=True):
            block[is_there] = _numbers(stream, column, rows[is_there])
    return np.concatenate([*blocks, num_different(np.stack(blocks, axis=1))], axis=1)


def _numbers(stream: StreamView, column: Column, rows: Index) -> Array:
    """Numbers of a column, of the shape of the rows."""
    if column.type == "string":
        codes, categories = stream.categories(column.name)
        places = {text: float(place) for place, text in enumerate(column.values)}
        lookup = [places[text] if text in places else _hashed(text) for text in categories]
        return np.asarray(np.array([*lookup, np.nan])[codes[rows]])
    values = stream[column.name][rows].astype(np.float64)
    if stream.num_nulls(column.name):
        values[~stream.valid(column.name)[rows]] = np.nan
    return values


def _hashed(text: str) -> float:
    return float(int.from_bytes(hashlib.sha256(text.encode()).digest()[:_HASHED_BYTES], "little"))


def _sums(stream: StreamView, first: Index, stop: Index) -> list[Array]:
    """Sums of every column over the rows ``first .. stop - 1`` of moments ``[attempts, moments]``."""
    counts = (stop - first).ravel()
    ends = np.cumsum(counts)
    rows = np.arange(counts.sum()) + np.repeat(first.ravel() - ends + counts, counts)
    found = []
    for column in value_columns("actors"):
        numbers = _numbers(stream, column, rows)
        steps = np.rint(np.where(np.isnan(numbers), _NULL_OF_ACTOR, numbers) * _STEPS).astype(np.int64)
        upto = np.concatenate(([0], np.cumsum(steps)))
        sums = (upto[ends] - upto[ends - counts]).astype(np.float64)
        found.append(sums.reshape(first.shape) / _STEPS)
    return found
