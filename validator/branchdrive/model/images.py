"""Images of the histories of groups: where each lies in the raw layer, and its bytes when they are asked for.

An image is found through the media index of the model layer and read by itself, one range of one file. What is read
is held against the checksum of the index, so that nobody works on other images than those that the release lists.

Source: paper, "Release Structure" (modality paths); spec/12-model.md#media.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from io import BufferedReader
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import spec_limits
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.errors import DatasetError
from branchdrive.formats.untrusted import Links, open_file
from branchdrive.raw.media import CHECKSUM_DIGITS
from branchdrive.tables.frame import Values

__all__ = ["ImageHistory"]

_MAX_OPEN = 16
"""Files that are open at once; a dataset may have a file for each image."""


class ImageHistory:
    """The images of some cameras over the 16 observations up to the branch, of some groups.

    A context manager: files that were opened to read images are closed at its end.

    Attributes:
        groups: Ids of the groups, ``N`` of them.
        cameras: Names of the cameras, ``C`` of them.
        available: Which images the release has, ``[N, 16, C]``.
        checksums: Checksums of the index, ``[N, 16, C]`` of text; empty where there is no image.
    """

    def __init__(
        self,
        root: Path,
        index: Mapping[str, Values],
        groups: Sequence[str],
        cameras: Sequence[str],
        *,
        links: Links = None,
    ) -> None:
        self.groups, self.cameras = tuple(groups), tuple(cameras)
        self._root, self._links, self._index = root, links, index
        self._row = _packed(root, index, self.groups, self.cameras)
        self.available: NDArray[np.bool_] = self._row >= 0
        known = np.concatenate([np.asarray(index["checksum"], object), [""]])
        self.checksums: NDArray[np.object_] = known[self._row]
        self._open: dict[str, BufferedReader] = {}

    def read(self, group: int, step: int, camera: int) -> bytes:
        """Bytes of one image, by its place on the axes of `available`.

        Raises:
            DatasetError: There is none, it cannot be read, or it is not the one of the index.
        """
        row = int(self._row[group, step, camera])
        if row < 0:
            raise DatasetError(
                f"{self._root}: group {self.groups[group]!r} has no image of `{self.cameras[camera]}` at the "
                f"observation {HISTORY_OFFSETS[step]} ticks from its branch"
            )
        path = f"{self._index['shard'][row]}/{self._index['file'][row]}"
        offset, size = int(self._index["offset_bytes"][row]), int(self._index["size_bytes"][row])
        if size > spec_limits().max_image_bytes:
            raise DatasetError(f"{self._root}: {path!r}: an image of {size} bytes is above the spec limit")
        stream = self._stream(path)
        stream.seek(offset)
        content = stream.read(size)
        if hashlib.sha256(content).hexdigest()[:CHECKSUM_DIGITS] != self._index["checksum"][row]:
            raise DatasetError(
                f"{self._root}: {path!r}: the {size} bytes at {offset} are not the image of the media index; run "
                "`branchdrive-validate`"
            )
        return content

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()

    def __repr__(self) -> str:
        return f"ImageHistory({len(self.groups)} groups, {', '.join(self.cameras)}: {int(self.available.sum())} images)"

    def _stream(self, path: str) -> BufferedReader:
        if path not in self._open:
            if len(self._open) == _MAX_OPEN:
                self._close()
            try:
                self._open[path] = open_file(self._root, path, self._links)
            except DatasetError as error:
                raise DatasetError(f"{error}; images lie in the raw layer, which a detached release lacks") from error
        return self._open[path]

    def _close(self) -> None:
        for stream in self._open.values():
            stream.close()
        self._open.clear()


def _packed(
    root: Path, index: Mapping[str, Values], groups: Sequence[str], cameras: Sequence[str]
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
                f"{root}: the media index has another or a second row for `{camera}` of group {group!r} at {offset} "
                "ticks; run `branchdrive-validate`"
            )
        found[where] = row
    return found
