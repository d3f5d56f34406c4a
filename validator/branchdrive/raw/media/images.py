"""What the bytes and pixels of a shard's images say, row by row of its media index, for the rules on rows.

Images are read once, while their files are digested; what rules need of them is kept, and the pixels are not. Which
images are decoded depends on the mode alone: all, none, or a sample that is drawn by counters.

Source: spec/05-raw-streams.md#media.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.media import SAMPLE_STEP, MediaMode
from branchdrive.contract.semantic_bev import SemanticClass, classes_of
from branchdrive.raw.media.image_numbers import NAMES
from branchdrive.statistics.random_words import below, words

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["MAP_PARTS", "Comparison", "Images", "chosen_rows", "is_flat", "unknown_class"]

Mask = NDArray[np.bool_]
Pixels = NDArray[np.uint8]

MAP_PARTS = ("vehicles", "people", "ground", "signs")
"""Parts of semantic maps that are compared, each with what is recorded of it."""

_FLAT = 2
"""Largest difference of two values of a channel of an image that shows nothing."""


@dataclass(eq=False)
class Comparison:
    """Semantic maps against a part of what is recorded, in the order of the stored rows of the index.

    Attributes:
        is_compared: Whether an image was compared ``[rows]``.
        contradicted: Expected and found text of those that contradict it, by row.
    """

    is_compared: Mask
    contradicted: dict[int, tuple[str, str]] = field(default_factory=dict)

    def note(self, row: int, found: tuple[str, str] | None) -> None:
        """An image was compared, and `found` is what contradicts."""
        self.is_compared[row] = True
        if found is not None:
            self.contradicted[row] = found


@dataclass(eq=False)
class Images:
    """Facts of images, in the order of the stored rows of the index.

    Attributes:
        is_read: Whether its bytes are those of the index ``[rows]``.
        is_decoded: Whether its pixels were looked at, or could not be had ``[rows]``.
        maps: Semantic maps against what is recorded, by part; those with a class that there is not among `vehicles`.
        form: Expected and found text of images of another form than index and descriptor name, by row.
        damaged: Expected and found text of images that lack some of their bytes or have more, by row.
        undecodable: Why images do not decode, by row.
        flat: Rows of images of one colour.
        numbers: What stands for the pixels of an image ``[rows, numbers]``; NaN where not decoded.
        unjudged: Why pixels were not looked at, or not all; ``None`` where all were.
    """

    is_read: Mask
    is_decoded: Mask
    maps: Mapping[str, Comparison]
    form: dict[int, tuple[str, str]] = field(default_factory=dict)
    damaged: dict[int, tuple[str, str]] = field(default_factory=dict)
    undecodable: dict[int, str] = field(default_factory=dict)
    flat: set[int] = field(default_factory=set)
    numbers: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, len(NAMES)), np.float32))
    unjudged: str | None = None

    @classmethod
    def none(cls, num_rows: int) -> Images:
        """Of images that were not read yet."""
        maps = {part: Comparison(np.zeros(num_rows, bool)) for part in MAP_PARTS}
        numbers = np.broadcast_to(np.float32(np.nan), (num_rows, len(NAMES)))
        return cls(np.zeros(num_rows, bool), np.zeros(num_rows, bool), maps, numbers=numbers)


def chosen_rows(frames: pa.Table, mode: MediaMode) -> Mask:
    """Rows of the index whose images are decoded.

    A sample depends on the order of keys and on the first of them, so that shards differ, and not on the order of rows.
    """
    if mode != "sample" or not frames.num_rows:
        return np.full(frames.num_rows, mode == "full")
    import pyarrow as pa
    import pyarrow.compute as pc

    keys = {name: frames[name].cast(pa.string()) for name in ("rollout_id", "camera")}
    order = pc.sort_indices(
        pa.table({**keys, "tick": frames["tick"]}),
        sort_keys=[(name, "ascending") for name in ("rollout_id", "tick", "camera")],
    )
    order = order.to_numpy()
    first = keys["rollout_id"][int(order[0])].as_py()
    drawn = below(words(0, f"media/sample/{first}", frames.num_rows, 1)[:, 0], SAMPLE_STEP) == 0
    chosen = np.zeros(frames.num_rows, bool)
    chosen[order] = drawn
    return chosen


def is_flat(pixels: Pixels) -> bool:
    """Whether an image has one colour, but for the rounding of its encoding."""
    for step in (8, 1):  # most images show themselves in few of their pixels
        values = pixels[::step, ::step].reshape(-1, *pixels.shape[2:])
        if int(np.max(values.max(axis=0) - values.min(axis=0))) > _FLAT:
            return False
    return True


def unknown_class(pixels: Pixels) -> tuple[str, str] | None:
    """Expected and found text of a semantic map that holds a class that there is not."""
    classes, last = classes_of(pixels), max(SemanticClass)
    if classes.max() <= last:
        return None
    row, column = np.argwhere(classes > last)[0]
    return f"classes 0 .. {last.value}", f"class {classes[row, column]} at row {row}, column {column}"
