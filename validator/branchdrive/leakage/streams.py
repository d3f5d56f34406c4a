"""Every recorded column before the branch, as what the concordance of a leakage audit needs of it.

A column of a stream at one time is a number of every replay. Of a group's interventions their ranks are kept, and
how far apart the numbers lie: that is all a code needs to be seen, and it holds text and flags as well as metres.
Of an image, the numbers are its size in bytes and what `image_numbers` makes of its pixels, so that a mark in any
corner moves one. Values that repeat are seen by how many different ones there are in the whole window.

Source: this project's choice; spec/13-leakage.md#streams.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import STREAMS, TABLES, Column
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.timing import CONTROL_HISTORY_TICKS, HISTORY_OFFSETS, PREDECESSOR_OFFSET
from branchdrive.raw.media.image_numbers import NAMES

__all__ = [
    "COUNT", "DIFFERENT", "IMAGES", "WINDOWS", "StreamColumn", "Streams", "camera_columns", "examined_cameras",
    "num_different", "ranked", "stream_columns", "value_columns",
]  # fmt: skip

Array = NDArray[np.float64]

WINDOWS: dict[str, tuple[int, ...]] = {
    "observations": (PREDECESSOR_OFFSET, *HISTORY_OFFSETS),
    "evidence": HISTORY_OFFSETS,
    "actors": HISTORY_OFFSETS,
    "controls": tuple(range(-CONTROL_HISTORY_TICKS, 0)),
}
"""Offsets from ``t_b`` at which a table is read, by table in the order of columns."""

IMAGES = "frames"
"""Table whose columns are numbers of images, at the times of the evidence."""

COUNT = "number of rows"
"""What is read of the actors of a moment beside their values: how many there are."""

DIFFERENT = "number of different values"
"""What is read of a column beside its values: how many different ones a window has, a null being one."""

_SIZE = "size_bytes"


class StreamColumn(NamedTuple):
    """One column at one time.

    Attributes:
        table: Its table.
        name: Its name, or `COUNT`; with `DIFFERENT` behind it, what is counted; of an image, behind its camera.
        offset_ticks: Offset from ``t_b``; None where it is of the whole window.
    """

    table: str
    name: str
    offset_ticks: int | None


@dataclass(frozen=True, eq=False, repr=False)
class Streams:
    """Columns of the interventions of groups.

    Attributes:
        columns: What the last axis holds.
        ranks: Centred doubled ranks within a group ``[groups, interventions, columns]``, ties averaged.
        spread: Largest difference of two numbers of a group ``[groups, columns]``, infinite beside a null.

    Raises:
        ValueError: A shape is wrong.
    """

    columns: tuple[StreamColumn, ...]
    ranks: NDArray[np.int16]
    spread: NDArray[np.float32]

    def __post_init__(self) -> None:
        if self.ranks.ndim != 3 or self.ranks.shape[2] != len(self.columns):
            raise ValueError(f"`ranks` has shape {list(self.ranks.shape)}, not [groups, interventions, columns]")
        if self.spread.shape != (len(self.ranks), len(self.columns)):
            raise ValueError(f"`spread` has shape {list(self.spread.shape)}, not [groups, columns]")

    def __repr__(self) -> str:
        return f"Streams(ranks {list(self.ranks.shape)} int16, spread {list(self.spread.shape)} float32)"

    @classmethod
    def none(cls, num_groups: int, num_interventions: int) -> Streams:
        """No column of any stream."""
        shape = (num_groups, num_interventions, 0)
        return cls((), np.zeros(shape, np.int16), np.zeros((num_groups, 0), np.float32))

    @property
    def are_identical(self) -> bool:
        """Whether all interventions of every group have the same numbers."""
        return not self.ranks.any()


def value_columns(table: str) -> tuple[Column, ...]:
    """Columns of a table that are read: all but the identity of the attempt and the tick."""
    return tuple(column for column in TABLES[table].columns if column.name not in ("rollout_id", "tick"))


def examined_cameras(descriptor: Descriptor) -> tuple[str, ...]:
    """Cameras whose images models may read, in declared order: those of views for debugging are not among them."""
    tracks = {"sensor", "privileged"}
    return tuple(camera.name for camera in descriptor.cameras if STREAMS[camera.stream].track in tracks)


@lru_cache(4)
def stream_columns(tables: tuple[str, ...], cameras: tuple[str, ...] = ()) -> tuple[StreamColumn, ...]:
    """Columns of the given tables, then those of cameras.

    Of a table they are by column in declared order and by time, then the numbers of different values.
    """
    found: list[StreamColumn] = []
    for table, offsets in WINDOWS.items():
        if table not in tables:
            continue
        names = [column.name for column in value_columns(table)]
        if table == "actors":
            names.append(COUNT)
        found += [StreamColumn(table, name, offset) for name in names for offset in offsets]
        found += [StreamColumn(table, f"{name} {DIFFERENT}", None) for name in names]
    return (*found, *camera_columns(cameras))


def camera_columns(cameras: tuple[str, ...]) -> tuple[StreamColumn, ...]:
    """Columns of cameras: size and numbers of images by time, then the number of different images of each."""
    found: list[StreamColumn] = []
    for camera in cameras:
        names = [f"{camera} {name}" for name in (_SIZE, *NAMES)]
        found += [StreamColumn(IMAGES, name, offset) for name in names for offset in HISTORY_OFFSETS]
        found.append(StreamColumn(IMAGES, f"{camera} {DIFFERENT}", None))
    return tuple(found)


def num_different(values: Array) -> Array:
    """How many different numbers stand in the last axis; a NaN is one of them."""
    ordered = np.sort(np.where(np.isnan(values), np.inf, values), axis=-1)
    return np.asarray(1.0 + np.count_nonzero(ordered[..., 1:] != ordered[..., :-1], axis=-1))


def ranked(values: Array) -> tuple[NDArray[np.int16], NDArray[np.float32]]:
    """Ranks ``[groups, rows, columns]`` and spread ``[groups, columns]`` of numbers ``[groups, rows, columns]``.

    A NaN stands for what is not there, below every number and infinitely far from it.
    """
    ordered = np.where(np.isnan(values), -np.inf, values)
    low, high = ordered.min(axis=1, initial=np.inf), ordered.max(axis=1, initial=-np.inf)
    ranks = np.zeros(values.shape, np.int16)
    differing = np.flatnonzero((low < high).any(axis=0))  # of replays of one history few columns differ
    compared, found = ordered[..., differing], ranks[..., differing]
    for other in range(values.shape[1]):
        found += compared > compared[:, other : other + 1]
        found -= compared < compared[:, other : other + 1]
    ranks[..., differing] = found
    with np.errstate(invalid="ignore", over="ignore"):
        spread = np.where(low < high, high - low, 0.0).astype(np.float32)
    return ranks, spread
