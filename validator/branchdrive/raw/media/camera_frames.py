"""Images of one camera in the order of time: nothing is read before it is asked for.

Source: spec/05-raw-streams.md#media.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, overload

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.semantic_bev import SEMANTIC_STREAM
from branchdrive.contract.text import quote
from branchdrive.errors import DatasetError, DecodeError, UsageError
from branchdrive.formats.image_codec import decode_image
from branchdrive.formats.image_header import disagreement, image_header
from branchdrive.raw.media.media_folder import ImagePlace, MediaFolder, places_of

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["CameraFrame", "CameraFrames"]


@dataclass(frozen=True, repr=False)
class CameraFrame:
    """One image, where it lies.

    Attributes:
        camera: Name of its camera.
        tick: When it was taken.
    """

    camera: str
    tick: int
    _place: ImagePlace
    _media: MediaFolder

    def read(self) -> bytes:
        """The encoded image, JPEG or PNG, by one ranged read.

        Raises:
            DatasetError: It is not where the index says, or not what the index says.
        """
        return self._media.read(self._place)

    def pixels(self) -> NDArray[np.uint8]:
        """The decoded image: ``[height, width, 3]`` of an RGB stream, ``[height, width]`` of a semantic map.

        Raises:
            DatasetError: As `read`, or the image is damaged or does not fit its camera.
            PlatformError: Neither Pillow nor OpenCV is there.
        """
        return _decoded(self, self.read())

    def __repr__(self) -> str:
        return f"CameraFrame({self.camera!r}, tick {self.tick}, {self._place.size_bytes} bytes)"


class CameraFrames(Sequence[CameraFrame]):
    """Images of one camera, by tick; made by `Rollout.frames` and `ModelLayer.frames`.

    Attributes:
        camera: Name of the camera.
        ticks: When the images were taken, int32 ``[images]``; of a model layer, relative to the branch.
    """

    def __init__(self, camera: str, ticks: NDArray[np.int32], places: Sequence[ImagePlace], media: MediaFolder) -> None:
        self.camera = camera
        self.ticks = ticks
        self._places = tuple(places)
        self._media = media

    @classmethod
    def of_rows(cls, camera: str, rows: pa.Table, media: MediaFolder, *, time: str = "tick") -> CameraFrames:
        """The images of a camera among rows of an index, by the column `time`."""
        import pyarrow.compute as pc

        chosen = rows.filter(pc.field("camera") == camera).sort_by(time)
        return cls(camera, chosen.column(time).to_numpy(), places_of(chosen), media)

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, index: int) -> CameraFrame: ...
    @overload
    def __getitem__(self, index: slice) -> CameraFrames: ...
    def __getitem__(self, index: int | slice) -> CameraFrame | CameraFrames:
        if isinstance(index, slice):
            return CameraFrames(self.camera, self.ticks[index], self._places[index], self._media)
        return CameraFrame(self.camera, int(self.ticks[index]), self._places[index], self._media)

    def at(self, ticks: Sequence[int] | NDArray[np.integer]) -> CameraFrames:
        """The images at ticks, in their order.

        Raises:
            UsageError: There is no image at one of them, or more than one.
        """
        wanted = np.asarray(ticks)
        first, after = (np.searchsorted(self.ticks, wanted, side=side) for side in ("left", "right"))
        unusable = wanted[after - first != 1]
        if unusable.size:
            raise UsageError(f"camera `{self.camera}` lacks or repeats images at ticks {unusable.tolist()}")
        places = [self._places[index] for index in first]
        return CameraFrames(self.camera, self.ticks[first], places, self._media)

    def pixels(self) -> NDArray[np.uint8]:
        """All images decoded: ``[images, height, width, 3]`` of an RGB stream, ``[images, height, width]`` of a map.

        Errors as `CameraFrame.pixels`.
        """
        declared = self._media.cameras[self.camera]
        channels = () if declared.stream == SEMANTIC_STREAM else (3,)
        decoded = np.empty((len(self), declared.height_px, declared.width_px, *channels), np.uint8)
        for index, image in enumerate(self._media.read_all(self._places)):
            decoded[index] = _decoded(self[index], image)
        return decoded

    def __repr__(self) -> str:
        return f"CameraFrames({self.camera!r}, {len(self)} images)"


def _decoded(frame: CameraFrame, image: bytes) -> NDArray[np.uint8]:
    """Pixels of an image, after its header agrees with its camera, so that none is larger than declared."""
    where = f"camera `{frame.camera}`, tick {frame.tick}"
    try:
        header = image_header(image)
        expected = disagreement(header, frame._media.cameras[frame.camera])
        if expected is not None:
            raise DecodeError(f"expected {expected}, found {header}")
        return decode_image(image)
    except DecodeError as error:
        raise DatasetError(f"{where}: {quote(str(error))}; run `branchdrive-validate`") from error
