"""Images of one rollout while it runs: each goes to a file at once, and only where it lies is kept in memory.

Source: spec/05-raw-streams.md#media.
"""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from branchdrive.contract.camera import Camera
from branchdrive.contract.columns import TABLES
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.text import quote
from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS
from branchdrive.errors import ContractError, DecodeError, UsageError
from branchdrive.formats.file_error import named
from branchdrive.formats.image_header import disagreement, read_header
from branchdrive.formats.image_parts import find_flaw
from branchdrive.raw.media.media_folder import FRAMES, MediaFolder, image_checksum, places_of
from branchdrive.raw.rollout import Rollout, RolloutTables
from branchdrive.writer.buffer import RowBuffer

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["STAGED_MEDIA", "MediaBuffer"]

STAGED_MEDIA = "media.bin"
"""File of a staged rollout that holds its images, one after the other."""


class MediaBuffer:
    """Takes the encoded images of one rollout.

    Args:
        path: File that they go to; made with the first of them.
        folder: Where they will be when the rollout is finished.
    """

    def __init__(self, path: Path, folder: MediaFolder) -> None:
        self.folder = folder
        self._path = path
        self._cameras = folder.cameras
        self._stream: BinaryIO | None = None
        self._rows: dict[tuple[int, str], dict[str, object]] = {}

    def append(self, tick: int, camera: str, image: bytes) -> None:
        """Take one image.

        Raises:
            UsageError: The camera is not declared, the tick is that of no saved observation, or the camera has an
                image of it already.
            ContractError: The image is no PNG or JPEG, is cut off, is too large, or does not fit its camera.
        """
        where = f"image of camera {quote(camera)} at tick {quote(tick)}"
        declared = self._cameras.get(camera)
        if declared is None:
            raise UsageError(f"{where}: the descriptor declares the cameras {sorted(self._cameras)}; name one of them")
        if (
            isinstance(tick, bool)
            or not isinstance(tick, int | np.integer)
            or tick < 0
            or tick % OBSERVATION_STRIDE_TICKS
        ):
            raise UsageError(f"{where}: observations are saved at ticks 0, 5, 10 and so on; give the tick of one")
        if (int(tick), camera) in self._rows:
            raise UsageError(f"{where}: the camera has an image of this observation already; give each once")
        self._rows[int(tick), camera] = self._stored(image, declared, where)

    def _stored(self, image: bytes, camera: Camera, where: str) -> dict[str, object]:
        if not isinstance(image, bytes | bytearray | memoryview):
            found = type(image).__name__
            raise UsageError(
                f"{where}: expected the bytes of an encoded image, found {found}; encode it as PNG or JPEG"
            )
        if len(image) > spec_limits().max_image_bytes:
            raise ContractError(f"{where}: has {len(image)} bytes; the limit is {spec_limits().max_image_bytes}")
        try:
            header = read_header(bytes(image))
        except DecodeError as error:
            raise ContractError(f"{where}: {error}; give a whole PNG or JPEG") from error
        expected = disagreement(header, camera)
        if expected is not None:
            raise ContractError(f"{where}: expected {expected}, found {header}")
        if (flaw := find_flaw(bytes(image), header.encoding)) is not None:
            raise ContractError(f"{where}: expected {flaw.expected}, found {flaw.found}")
        with named(self._path):
            if self._stream is None:
                self._stream = self._path.open("wb")
            offset = self._stream.tell()
            self._stream.write(image)
        return {
            "file": STAGED_MEDIA, "offset_bytes": offset, "size_bytes": len(image), "checksum": image_checksum(image),
            "encoding": header.encoding,
        }  # fmt: skip

    def keep(self, ticks: Collection[int]) -> None:
        """Leave out the images of all other ticks."""
        kept = {int(tick) for tick in ticks}
        self._rows = {(tick, camera): row for (tick, camera), row in self._rows.items() if tick in kept}

    def take_over(self, rollout: Rollout) -> Rollout:
        """Take the images of a finished rollout from where they are; the rollout, with the index of their new places.

        Raises:
            DatasetError: An image is not where its index says, or not what it says.
            ContractError: It does not fit its camera.
        """
        frames = rollout.tables[FRAMES]
        ticks, cameras = (frames.column(name).to_pylist() for name in ("tick", "camera"))
        if rollout.media is not None:
            images = rollout.media.read_all(places_of(frames))
            for tick, camera, image in zip(ticks, cameras, images, strict=True):
                self.append(tick, camera, image)
        tables = RolloutTables({**rollout.tables, FRAMES: self.to_table(rollout.rollout_id)})
        return Rollout(rollout.record, tables, self.folder)

    def to_table(self, rollout_id: str) -> pa.Table:
        """The index of the images, with the declared schema, by tick and camera."""
        rows = RowBuffer(TABLES[FRAMES], ())
        for (tick, camera), row in self._rows.items():
            rows.append({"tick": tick, "camera": camera, **row})
        return rows.to_table(rollout_id)

    def hand_over(self, folder: Path) -> None:
        """Make the file durable and move it into the folder of the finished rollout."""
        if self._stream is not None:
            with named(self._path):
                self._stream.flush()
                os.fsync(self._stream.fileno())
            self._path.rename(folder / STAGED_MEDIA)

    def close(self) -> None:
        """Delete what was not handed over."""
        if self._stream is not None:
            self._stream.close()
            self._path.unlink(missing_ok=True)
