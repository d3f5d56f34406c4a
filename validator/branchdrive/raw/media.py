"""Media files of a shard: digested and compared with the index in one pass, and their images looked at on the way.

Every byte is read once; no more than a part of a file and one image are held. What an image claims to be bounds what
decoding it may take, so its header is compared with the camera before anything is decoded.

Source: spec/05-raw-streams.md#media.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.camera import Camera
from branchdrive.contract.columns import PATTERNS
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.media import SAMPLE_STEP, MediaMode
from branchdrive.contract.mismatch import Location, Mismatch
from branchdrive.contract.semantic_bev import SEMANTIC_STREAM
from branchdrive.contract.text import quote
from branchdrive.errors import DatasetError, DecodeError
from branchdrive.formats.image_codec import NO_DECODER, can_decode, decode_image
from branchdrive.formats.image_header import ImageHeader, disagreement, read_header
from branchdrive.formats.image_parts import find_flaw
from branchdrive.formats.media_archive import HEADER_BYTES, holds_member
from branchdrive.formats.stored_code import HEAD_BYTES, stored_code
from branchdrive.formats.untrusted import Links, open_file
from branchdrive.raw.images import Images, cell_means, chosen_rows, is_flat, unknown_class

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["CHECKSUM_DIGITS", "Look", "Looks", "MediaReading", "read_media"]

_FILE_NAME = re.compile(PATTERNS["file"].removeprefix("^").removesuffix("$"))
_PIECE_BYTES = 1 << 20

_MAX_OVERLAP = 2
"""How often the bytes of a file are looked at as images, on average: ranges that overlap cost as if they did not."""

_MAX_SIGHTS = 20_000
"""How many images are remembered by their bytes: attempts of a group see the same before their branch."""

CHECKSUM_DIGITS = 16
"""Hexadecimal digits of an image's SHA-256 that the index records."""


class Look(Protocol):
    """Comparison of semantic maps with a part of what is recorded.

    Attributes:
        is_judged: Whether there is anything to compare the image with ``[stored rows]``.
    """

    is_judged: NDArray[np.bool_]

    def __call__(self, stored_row: int, pixels: NDArray[np.uint8], /) -> tuple[str, str] | None:
        """What is expected and found otherwise in the pixels of the image of a stored row, where anything is."""


@dataclass(frozen=True)
class Looks:
    """What decoded semantic maps are compared with, as far as there is anything.

    Attributes:
        bodies: Recorded vehicles.
        ground: Recorded roads and routes.
    """

    bodies: Look | None = None
    ground: Look | None = None


_Image: TypeAlias = tuple[int, int, str, str, int, str, str, int]
"""Offset, size, checksum, rollout, tick, camera and encoding of an image, and its row of the index."""

_Sight: TypeAlias = tuple[NDArray[np.float32], bool] | str
"""Means of the cells of an image, and whether it has one colour; or why it does not decode."""

_NO_LOOKS = Looks()

_COLUMNS = ("file", "offset_bytes", "size_bytes", "checksum", "rollout_id", "tick", "camera", "encoding")


@dataclass(eq=False)
class MediaReading:
    """What became of the media files of a shard.

    Attributes:
        digests: SHA-256 of the files that are digested here.
        unreadable: Why files could not be read.
        over_limit: How files exceed the limits.
        stored_code: Files that hold code, and of which kind.
        mismatches: Images that are not where the index says.
        images: What the images say; ``None`` where the shard has no index that can be read.
    """

    digests: dict[str, str] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)
    over_limit: dict[str, str] = field(default_factory=dict)
    stored_code: dict[str, str] = field(default_factory=dict)
    mismatches: list[Mismatch] = field(default_factory=list)
    images: Images | None = None


def read_media(
    root: Path,
    folder: str,
    files: Collection[str],
    frames: pa.Table | None,
    cameras: Mapping[str, Camera],
    *,
    media: Collection[str] = (),
    mode: MediaMode = "full",
    is_hashed: bool = True,
    looks: Looks = _NO_LOOKS,
    links: Links = None,
) -> MediaReading:
    """Read the media files of a shard.

    Args:
        root: The dataset folder.
        folder: The shard's folder, relative to the root.
        files: Its regular files, relative to the root.
        media: Those of them that are no tables.
        frames: Its media index with the declared columns; ``None`` if it has none that can be read.
        cameras: Cameras of the descriptor by name.
        mode: Which images are decoded.
        is_hashed: Whether what is no table is digested.
        looks: Called with the pixels of every decoded semantic map that they judge.
        links: Folders that links may lead into.
    """
    reading = MediaReading()
    by_file = {} if frames is None else _by_file(folder, frames)
    eye = None if frames is None else _Eye(reading, frames, cameras, mode, looks)
    for path in sorted({*by_file, *media}):
        images = by_file.get(path, [])
        if path not in files:
            reading.mismatches.append(Mismatch({"file": path}, "a file of the shard", "no such file", len(images)))
            continue
        is_digested = is_hashed and path in media
        try:
            with open_file(root, path, links) as stream:
                num_bytes = os.fstat(stream.fileno()).st_size
                if is_digested and num_bytes > spec_limits().max_media_bytes:
                    reading.over_limit[path] = f"has more than {spec_limits().max_media_bytes} bytes, the limit"
                part = _Part(stream, is_digested and path not in reading.over_limit)
                if path in media and (kind := stored_code(path, part.bytes_at(0, HEAD_BYTES))):
                    reading.stored_code[path] = kind
                if (indexed := _indexed_bytes(images, num_bytes)) > _MAX_OVERLAP * num_bytes:
                    expected = f"ranges of at most {_MAX_OVERLAP} x {num_bytes} bytes together"
                    found = f"ranges that overlap: {indexed} bytes"
                    reading.mismatches.append(Mismatch({"file": path}, expected, found, len(images)))
                elif eye is not None:
                    for image in images:
                        eye.see(path, image, part)
                if part.digest is not None:
                    reading.digests[path] = part.finish()
        except (DatasetError, OSError) as error:
            if is_digested:
                reading.unreadable[path] = str(error)
            if images:
                reading.mismatches.append(Mismatch({"file": path}, "a file that can be read", str(error), len(images)))
    if eye is not None:
        eye.finish()
    return reading


def _by_file(folder: str, frames: pa.Table) -> dict[str, list[_Image]]:
    """Images of every file, by place; nulls and unsafe names are reported by other rules."""
    by_file: dict[str, list[_Image]] = {}
    has_nulls = any(frames[column].null_count for column in _COLUMNS)
    names, *cells = (frames[column].to_pylist() for column in _COLUMNS)
    for name, *image in zip(names, *cells, range(frames.num_rows), strict=True):
        if not (has_nulls and None in (name, *image)):
            by_file.setdefault(name, []).append(tuple(image))
    return {f"{folder}/{name}": sorted(by_file[name]) for name in by_file if _FILE_NAME.fullmatch(name)}


def _indexed_bytes(images: list[_Image], num_bytes: int) -> int:
    """Bytes of a file in the ranges of its images, equal ranges counted once."""
    return sum(max(min(size, num_bytes - offset), 0) for offset, size in {image[:2] for image in images} if offset >= 0)


class _Part:
    """A part of a file that is read from its start on, once."""

    def __init__(self, stream: BufferedReader, is_hashed: bool) -> None:
        self._stream = stream
        self._base, self._bytes = 0, b""
        self.digest = hashlib.sha256() if is_hashed else None

    def bytes_at(self, offset: int, size: int) -> bytes:
        """Bytes of the file, fewer where it ends; offsets do not fall from call to call."""
        stop = offset + size
        while self._base + len(self._bytes) < stop:
            if self.digest is None and offset > self._base + len(self._bytes):
                self._stream.seek(offset)
                self._base, self._bytes = offset, b""
            piece = self._stream.read(max(_PIECE_BYTES, min(stop - self._base - len(self._bytes), size)))
            if not piece:
                break
            if self.digest is not None:
                self.digest.update(piece)
            kept = self._bytes[max(offset - self._base, 0) :]
            self._base += len(self._bytes) - len(kept)
            self._bytes = kept + piece
        return self._bytes[max(offset - self._base, 0) : stop - self._base]

    def finish(self) -> str:
        """Digest of the whole file; reads the rest of it."""
        if self.digest is None:
            raise ValueError("the file is not digested")
        while piece := self._stream.read(_PIECE_BYTES):
            self.digest.update(piece)
        return self.digest.hexdigest()


class _Eye:
    """Looks at images one after the other; the same bytes are decoded once, but where pixels are compared."""

    def __init__(
        self,
        reading: MediaReading,
        frames: pa.Table,
        cameras: Mapping[str, Camera],
        mode: MediaMode,
        looks: Looks,
    ) -> None:
        images = reading.images = Images.none(frames.num_rows)
        chosen = chosen_rows(frames, mode)
        if mode == "index":
            images.unjudged = "images were not decoded"
        elif not can_decode():
            images.unjudged = NO_DECODER
            chosen[:] = False
        elif mode == "sample":
            images.unjudged = f"one image in {SAMPLE_STEP:,} was decoded, {chosen.sum():,} of a shard"
        self._reading, self._images, self._cameras = reading, images, cameras
        self._looks = ((looks.bodies, images.bodies), (looks.ground, images.ground))
        self._chosen, self._max_bytes = chosen.tolist(), spec_limits().max_image_bytes
        self._headers: dict[str, tuple[bytes, ImageHeader]] = {}
        self._read: list[int] = []
        self._place: tuple[str, int, int] | None = None
        self._is_member = True
        self._content, self._digest = b"", ""
        self._pixels: NDArray[np.uint8] | None = None
        self._sights: dict[str, _Sight] = {}

    def see(self, path: str, image: _Image, part: _Part) -> None:
        """Compare an image with the index, and look at it."""
        offset, size, checksum, _, _, camera_name, _, row = image
        if not (offset >= 0 and 0 < size <= self._max_bytes):
            self._blame(path, image, f"1 .. {self._max_bytes} bytes of the file", f"{size} bytes from {offset}")
            return
        if self._place != (path, offset, size):
            self._place = path, offset, size
            self._is_member = not path.endswith(".tar") or (
                offset >= HEADER_BYTES and holds_member(part.bytes_at(offset - HEADER_BYTES, HEADER_BYTES), size)
            )
            self._content = part.bytes_at(offset, size)
            self._digest = hashlib.sha256(self._content).hexdigest()
            self._pixels = None
        if len(self._content) < size:
            self._blame(path, image, f"{size} bytes from {offset}", f"{len(self._content)} bytes: the file ends")
        elif (found := self._digest[:CHECKSUM_DIGITS]) != checksum:
            self._blame(path, image, f"checksum {found} of {size} bytes from {offset}", quote(checksum))
        else:
            if not self._is_member:
                expected = f"a header of a member of {size} bytes before {offset}, as an archive has one"
                self._blame(path, image, expected, "none")
            self._read.append(row)
            camera = self._cameras.get(camera_name)
            if camera is not None and self._is_sound(image, camera) and self._chosen[row]:
                self._decode(row, camera)

    def finish(self) -> None:
        """Note which images were read."""
        self._images.is_read[self._read] = True

    def _blame(self, path: str, image: _Image, expected: str, found: str) -> None:
        rollout_id, tick, camera = image[3:6]
        place: Location = {"file": path, "table": "frames", "rollout_id": rollout_id, "tick": tick, "camera": camera}
        self._reading.mismatches.append(Mismatch(place, expected, found))

    def _is_sound(self, image: _Image, camera: Camera) -> bool:
        """Whether an image has the form of its camera, and all of its bytes."""
        encoding, row = image[6:]
        begin, header = self._headers.get(camera.name, (b"", None))
        if header is None or not self._content.startswith(begin):
            try:
                header = read_header(self._content)
            except DecodeError as error:
                self._images.form[row] = f"a {encoding} of camera {camera.name}", str(error)
                return False
            expected = disagreement(header, camera)
            if expected is None and header.width_px * header.height_px > spec_limits().max_image_pixels:
                expected = f"at most {spec_limits().max_image_pixels:,} pixels"
            if expected is not None:
                self._images.form[row] = expected, str(header)
                return False
            self._headers[camera.name] = self._content[: header.num_bytes], header
        if header.encoding != encoding:
            self._images.form[row] = f"a {encoding}", str(header)
            return False
        flaw = find_flaw(self._content, encoding)
        if flaw is not None:
            flawed = self._images.form if flaw.is_of_form else self._images.damaged
            flawed[row] = flaw.expected, flaw.found
        return flaw is None

    def _decode(self, row: int, camera: Camera) -> None:
        images, is_map = self._images, camera.stream == SEMANTIC_STREAM
        images.is_decoded[row] = True
        sight = self._sight(needs_pixels=is_map)
        if isinstance(sight, str):
            images.undecodable[row] = sight
            return
        images.cells[row], has_one_colour = sight
        if not is_map or self._pixels is None:
            if has_one_colour:
                images.flat.add(row)
            return
        if (found := unknown_class(self._pixels)) is not None:
            images.bodies.note(row, found)
            return
        for look, comparison in self._looks:
            if look is not None and look.is_judged[row]:
                comparison.note(row, look(row, self._pixels))

    def _sight(self, *, needs_pixels: bool) -> _Sight:
        """What there is to see, with the pixels where they are needed and there are any."""
        sight = self._sights.get(self._digest)
        if sight is None or (needs_pixels and self._pixels is None and not isinstance(sight, str)):
            try:
                self._pixels = decode_image(self._content)
                sight = cell_means(self._pixels), is_flat(self._pixels)
            except DecodeError as error:
                sight = str(error)
            if len(self._sights) >= _MAX_SIGHTS:
                self._sights.clear()
            self._sights[self._digest] = sight
        return sight
