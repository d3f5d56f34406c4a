"""Images of the histories of groups: the rows of their index, which there are, and their bytes when asked for.

An image is found through the media index of the model layer and read by itself, one range of one file. What is read
is held against the checksum of the index, so that no image is used that the release does not list.

Source: paper, "Release Structure" (modality paths); spec/12-model.md#media.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.errors import DatasetError
from branchdrive.formats.store import Store
from branchdrive.model.inputs import empty_columns
from branchdrive.raw.media.media_folder import ImagePlace, MediaFolder
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.frame import Values

__all__ = ["ImageHistory", "media_columns"]


class ImageHistory:
    """The images of some cameras over the 16 observations up to the branch, of some groups.

    Attributes:
        groups: Ids of the groups, ``N`` of them.
        cameras: Names of the cameras, ``C`` of them.
        available: Which images the release has, ``[N, 16, C]``.
        checksums: Checksums of the index, ``[N, 16, C]`` of text; empty where there is no image.
    """

    def __init__(
        self,
        dataset: Store,
        descriptor: Descriptor,
        index: Mapping[str, Values],
        groups: Sequence[str],
        cameras: Sequence[str],
    ) -> None:
        self.groups, self.cameras = tuple(groups), tuple(cameras)
        self._dataset, self._descriptor, self._index = dataset, descriptor, index
        self._row = _packed(dataset, index, self.groups, self.cameras)
        self.available: NDArray[np.bool_] = self._row >= 0
        known = np.concatenate([np.asarray(index["checksum"], object), [""]])
        self.checksums: NDArray[np.object_] = known[self._row]

    def read(self, group: int, step: int, camera: int) -> bytes:
        """Bytes of one image, by its place on the axes of `available`.

        Raises:
            DatasetError: There is none, it cannot be read, or it is not the one of the index.
        """
        row = int(self._row[group, step, camera])
        if row < 0:
            raise DatasetError(
                f"{self._dataset}: group {self.groups[group]!r} has no image of `{self.cameras[camera]}` at the "
                f"observation {HISTORY_OFFSETS[step]} ticks from its branch"
            )
        return self._read([row])[0]

    def read_all(self, group: int) -> list[bytes]:
        """Bytes of all images that a group has, step by step and camera by camera; errors as `read`."""
        return self._read(self._row[group][self.available[group]].tolist())

    def __repr__(self) -> str:
        return f"ImageHistory({len(self.groups)} groups, {', '.join(self.cameras)}: {int(self.available.sum())} images)"

    def _read(self, rows: Iterable[int]) -> list[bytes]:
        places: dict[str, list[ImagePlace]] = {}  # a group lies in one shard
        for row in rows:
            place = ImagePlace(*(self._index[name][row] for name in ImagePlace._fields))
            places.setdefault(str(self._index["shard"][row]), []).append(place)
        found: list[bytes] = []
        for shard, there in places.items():
            status = self._dataset.status(shard)
            if status is None or status.kind != "folder":
                raise DatasetError(
                    f"{self._dataset}: {shard!r} is not here, and images lie in the raw layer; use the release in "
                    "place, which `branchdrive build DATASET` makes without `--output`"
                )
            folder = MediaFolder(self._dataset, shard, self._descriptor.cameras_by_name)
            found += folder.read_all(there)
        return found


def _packed(
    dataset: Store, index: Mapping[str, Values], groups: Sequence[str], cameras: Sequence[str]
) -> NDArray[np.int64]:
    """Row of the index of every image ``[N, 16, C]``, -1 where there is none."""
    found = np.full((len(groups), len(HISTORY_OFFSETS), len(cameras)), -1, np.int64)
    place, camera_of = ({name: i for i, name in enumerate(names)} for names in (groups, cameras))
    step_of = {offset: step for step, offset in enumerate(HISTORY_OFFSETS)}
    keys = zip(index["group_id"].tolist(), index["offset_ticks"].tolist(), index["camera"].tolist(), strict=True)
    for row, (group, offset, camera) in enumerate(keys):
        if group not in place or camera not in camera_of:
            continue
        where = place[group], step_of.get(offset, -1), camera_of[camera]
        if where[1] < 0 or found[where] >= 0:
            raise DatasetError(
                f"{dataset}: the media index has another or a second row for `{camera}` of group {group!r} at {offset} "
                "ticks; run `branchdrive-validate`"
            )
        found[where] = row
    return found


def media_columns(view: ShardView, nominals: NDArray[np.int64]) -> dict[str, Values]:
    """Rows of the media index of `nominals` at the 16 observations up to the branch; none without media."""
    declared = [column for column in LAYER_TABLES["media_index"].columns if column.name != "partition"]
    if "frames" not in view:
        return empty_columns(declared)
    frames = view.stream("frames")
    owner = frames.rollout
    offset = np.where(owner >= 0, frames.tick - view.branch_tick[owner], 1)
    rows = np.flatnonzero(np.isin(owner, nominals) & np.isin(offset, HISTORY_OFFSETS))
    return {
        "group_id": view.rollouts["group_id"][owner[rows]],
        "offset_ticks": offset[rows].astype(np.int32),
        "shard": np.full(len(rows), view.file_prefix, object),
        **{
            column.name: frames[column.name][rows]
            for column in declared
            if column.name not in ("group_id", "offset_ticks", "shard")
        },
    }
