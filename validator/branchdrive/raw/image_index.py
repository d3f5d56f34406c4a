"""Images of a shard by attempt, camera and tick, and what tells them apart.

Source: spec/05-raw-streams.md#media.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Mask
from branchdrive.raw.shard_view import ShardView

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
        frames = self._frames = view.stream("frames")
        codes, self.cameras = frames.categories("camera")
        self.camera = codes.astype(np.int64)
        self._content = frames.categories("checksum")[0]
        key = self._moment(frames.rollout, self.camera, frames.tick)
        self._order = np.argsort(key, kind="stable")
        self._key = key[self._order]

    def _moment(self, rollout: Index, camera: Index, tick: Index) -> Index:
        """A number for every attempt, camera and tick: cameras are fewer than 2 ** 12, ticks than 2 ** 21."""
        return (rollout << 33) + (camera << 21) + tick

    def find(self, rollout: Index, camera: Index, tick: Index) -> Index:
        """Row of an image of each (attempt, camera, tick), -1 where there is none; any shape that they share."""
        wanted = self._moment(rollout, camera, tick)
        if not len(self._key):
            return np.full(wanted.shape, -1)
        place = np.minimum(np.searchsorted(self._key, wanted), len(self._key) - 1)
        return np.where((self._key[place] == wanted) & (rollout >= 0), self._order[place], -1)

    def differ(self, rows: Index, others: Index) -> Mask:
        """Whether images have other bytes than others, by the rows of both, which exist."""
        return np.asarray(self._content[rows] != self._content[others])
