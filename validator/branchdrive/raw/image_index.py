"""Images of a shard by attempt, camera and tick, and what tells them apart.

Source: spec/05-raw-streams.md#media.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mask
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.join import KeyIndex

__all__ = ["ImageIndex"]

Index = NDArray[np.int64]


class ImageIndex:
    """The media index of a shard, to be asked for single images.

    Args:
        view: The shard, with its media index.

    Attributes:
        camera: Camera of every row, as an index into `cameras` ``[rows]``.
        cameras: Names of the cameras that have images.
    """

    def __init__(self, view: ShardView) -> None:
        frames = view.stream("frames")
        codes, self.cameras = frames.categories("camera")
        self.camera = codes.astype(np.int64)
        self._content = frames.categories("checksum")[0]
        self._rows = KeyIndex(frames.rollout, self.camera, frames.tick)

    def find(self, rollout: Index, camera: Index | int, tick: Index) -> Index:
        """Row of an image of each (attempt, camera, tick), -1 where there is none; of the shape that they share."""
        return np.where(rollout >= 0, self._rows.find(rollout, camera, tick), -1)

    def differ(self, rows: Index, others: Index) -> Mask:
        """Whether images have other bytes than others, by the rows of both, which exist."""
        return np.asarray(self._content[rows] != self._content[others])
