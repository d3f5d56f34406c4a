"""Where tracks of actors begin and end, seen from the ego. Source: spec/05-raw-streams.md#completeness."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import TABLES
from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import Mask
from branchdrive.driving.risk import RANGE_M

__all__ = ["CLASSES", "MEASURES", "TrackEnds"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CLASSES = TABLES["actors"]["actor_class"].values

MEASURES = ("between the centres", "between the boxes")


class TrackEnds(NamedTuple):
    """Ends of tracks with an observation beyond them, and how far away rows are; in few bytes, as the parent holds all.

    Attributes:
        is_begin: Where a track begins; elsewhere it ends ``[ends]``.
        kind: Class of the actor, an index into `CLASSES` ``[ends]``.
        group: Digest of the group ``[ends]``.
        beyond_m: Distance to the ego one observation beyond the track, by each of `MEASURES` ``[ends, 2]``.
        farthest_m: Largest distance of a row of each class, by each measure ``[classes, 2]``; 0 without rows.
    """

    is_begin: Mask
    kind: NDArray[np.integer]
    group: Index
    beyond_m: NDArray[np.floating]
    farthest_m: Array

    @property
    def in_range(self) -> Mask:
        """Ends in range, however an actor may change its speed within a quarter second."""
        return np.asarray(self.beyond_m[:, 1] <= RANGE_M - physical_bounds().edge_m)

    @classmethod
    def of_all(cls, parts: Iterable[TrackEnds]) -> TrackEnds:
        """Those of several shards."""
        listed = [cls.none(), *parts]
        begins, kinds, groups, beyond_m = (np.concatenate([part[i] for part in listed]) for i in range(4))
        return cls(begins, kinds, groups, beyond_m, np.max([part.farthest_m for part in listed], axis=0))

    @classmethod
    def none(cls) -> TrackEnds:
        """No ends and no rows."""
        index = np.zeros(0, np.int64)
        return cls(np.zeros(0, bool), index, index, np.zeros((0, 2)), np.zeros((len(CLASSES), 2)))
