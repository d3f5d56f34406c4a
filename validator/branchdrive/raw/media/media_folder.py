"""Images of a shard or of a staged rollout, read one at a time.

Source: spec/05-raw-streams.md#media.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from branchdrive.contract.camera import Camera
from branchdrive.contract.columns import PATTERNS
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.text import quote
from branchdrive.errors import DatasetError
from branchdrive.formats.store import Store
from branchdrive.raw.media.image_eye import CHECKSUM_DIGITS

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["FRAMES", "ImagePlace", "MediaFolder", "image_checksum", "places_of"]

FRAMES = "frames"
"""Name of the table that says where images are."""

_ADVICE = "run `branchdrive-validate`"


class ImagePlace(NamedTuple):
    """Where an image is, and what it is known by."""

    file: str
    offset_bytes: int
    size_bytes: int
    checksum: str


def image_checksum(image: bytes | memoryview) -> str:
    """What the media index knows an image by."""
    return hashlib.sha256(image).hexdigest()[:CHECKSUM_DIGITS]


def places_of(frames: pa.Table) -> list[ImagePlace]:
    """Places of the images of an index, row by row."""
    columns = (frames.column(name).to_pylist() for name in ImagePlace._fields)
    return [ImagePlace(*row) for row in zip(*columns, strict=True)]


@dataclass(frozen=True)
class MediaFolder:
    """A folder with the images of a shard.

    Attributes:
        dataset: The dataset.
        folder: The shard's folder, relative to the root; empty where it is the root itself.
        cameras: Cameras of the descriptor by name.
    """

    dataset: Store
    folder: str
    cameras: Mapping[str, Camera]

    def read(self, place: ImagePlace) -> bytes:
        """The encoded image at a place, by one ranged read; errors as `read_all`."""
        (image,) = self.read_all([place])
        return image

    def read_all(self, places: Iterable[ImagePlace]) -> Iterator[bytes]:
        """The encoded images at places; images of one file that follow each other are read from one stream.

        Raises:
            DatasetError: A file has no plain name, is not there, is none or ends before the image, or the bytes are
                not those that the checksum was taken of.
        """
        opened: tuple[str, BinaryIO] | None = None
        with ExitStack() as stack:
            for place in places:
                if opened is None or opened[0] != place.file:
                    stack.close()
                    opened = place.file, stack.enter_context(self.dataset.open(self._path(place)))
                yield self._image(opened[1], place)

    def _path(self, place: ImagePlace) -> str:
        if not isinstance(place.file, str) or not re.fullmatch(PATTERNS["file"].rstrip("$"), place.file):
            raise DatasetError(
                f"{self.dataset.place(self.folder)}: {quote(place.file)} is no plain file name; {_ADVICE}"
            )
        return f"{self.folder}/{place.file}" if self.folder else place.file

    def _image(self, stream: BinaryIO, place: ImagePlace) -> bytes:
        where = f"{self.dataset.place(self._path(place))}, {place.size_bytes} bytes from {place.offset_bytes}"
        max_bytes = spec_limits().max_image_bytes
        if None in place or place.offset_bytes < 0 or not 0 < place.size_bytes <= max_bytes:
            raise DatasetError(f"{where}: an image has 1 .. {max_bytes} bytes; {_ADVICE}")
        stream.seek(place.offset_bytes)
        image = stream.read(place.size_bytes)
        if len(image) < place.size_bytes:
            raise DatasetError(f"{where}: the file ends before the image does; {_ADVICE}")
        if image_checksum(image) != place.checksum:
            raise DatasetError(f"{where}: the image is not that of its checksum {quote(place.checksum)}; {_ADVICE}")
        return image
