"""Images one after the other: compared with what an index claims of them, and their pixels looked at.

What an image claims to be bounds what decoding it may take, so its header is compared with the camera before anything
is decoded. Bytes are read and judged once for every claim, and the same bytes are decoded once, but where pixels are
compared with what is recorded beside them.

Source: spec/05-raw-streams.md#images.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.camera import Camera
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.media import SAMPLE_STEP, MediaMode
from branchdrive.contract.mismatch import Location, Mismatch, Mismatches
from branchdrive.contract.semantic_bev import SEMANTIC_STREAM
from branchdrive.contract.text import quote
from branchdrive.errors import DecodeError
from branchdrive.formats.file_part import FilePart
from branchdrive.formats.image_codec import NO_DECODER, can_decode, decode_image
from branchdrive.formats.image_header import ImageHeader, disagreement, read_header
from branchdrive.formats.image_parts import Flaw, find_flaw
from branchdrive.raw.media.image_claims import Claim, ImageClaims, Place
from branchdrive.raw.media.image_numbers import image_numbers
from branchdrive.raw.media.images import Images, chosen_rows, is_flat, unknown_class

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["CHECKSUM_DIGITS", "ImageEye", "Look"]

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


_Sight: TypeAlias = tuple[NDArray[np.float32], bool] | str
"""Numbers of an image, and whether it has one colour; or why it does not decode."""


class ImageEye:
    """Looks at the images of a shard.

    Args:
        frames: The media index with the declared columns.
        claims: What it says.
        cameras: Cameras of the descriptor by name.
        mode: Which images are decoded.
        looks: Called with the pixels of every decoded semantic map that they judge, by part of `MAP_PARTS`.

    Attributes:
        claims: What the index says.
        images: What the images say.
    """

    def __init__(
        self,
        frames: pa.Table,
        claims: ImageClaims,
        cameras: Mapping[str, Camera],
        mode: MediaMode,
        looks: Mapping[str, Look],
    ) -> None:
        self.images = images = Images.none(frames.num_rows)
        chosen = chosen_rows(frames, mode)
        if mode == "index":
            images.unjudged = "images were not decoded"
        elif not can_decode():
            images.unjudged = NO_DECODER
            chosen[:] = False
        elif mode == "sample":
            images.unjudged = f"one image in {SAMPLE_STEP:,} was decoded, {chosen.sum():,} of a shard"
        if chosen.any():
            images.numbers = images.numbers.copy()
        self.claims, self._cameras = claims, cameras
        self._looks = [(look, images.maps[part]) for part, look in looks.items()]
        self._chosen, self._max_bytes = chosen, spec_limits().max_image_bytes
        self._headers: dict[str, tuple[bytes, ImageHeader]] = {}
        self._content, self._digest = b"", ""
        self._flaws: dict[str, Flaw | None] = {}
        self._pixels: NDArray[np.uint8] | None = None
        self._sights: dict[str, _Sight] = {}

    def see(self, path: str, place: Place, part: FilePart, found: Mismatches) -> None:
        """Compare what lies at a place of a file with what is claimed of it, and look at it.

        Args:
            path: The file, relative to the root of the dataset.
            place: What the index names there.
            part: The bytes of the file.
            found: Where mismatches with the index are noted.
        """
        offset, size = place.offset, place.size
        if not (offset >= 0 and 0 < size <= self._max_bytes):
            expected = f"1 .. {self._max_bytes} bytes of the file"
            self._blame(path, place.claims, expected, f"{size} bytes from {offset}", found)
            return
        self._content, self._pixels, self._flaws = part.bytes_at(offset, size), None, {}
        if len(self._content) < size:
            there = f"{len(self._content)} bytes: the file ends"
            self._blame(path, place.claims, f"{size} bytes from {offset}", there, found)
            return
        self._digest = hashlib.sha256(self._content).hexdigest()
        checksum = self._digest[:CHECKSUM_DIGITS]
        for claim in place.claims:
            if claim.checksum == checksum:
                self._judge(claim)
            else:
                expected = f"checksum {checksum} of {size} bytes from {offset}"
                self._blame(path, [claim], expected, quote(claim.checksum), found)

    def _blame(self, path: str, claims: Iterable[Claim], expected: str, what: str, found: Mismatches) -> None:
        def at(row: int) -> Mismatch:
            place: Location = {"file": path, "table": "frames", **self.claims.key(row)._asdict()}
            return Mismatch(place, expected, what)

        for claim in claims:
            found.note(claim.rows.tolist(), at)

    def _judge(self, claim: Claim) -> None:
        """Look at the image whose bytes are those that a claim is about."""
        self.images.is_read[claim.rows] = True
        camera = self._cameras.get(claim.camera)
        if camera is None:
            return
        wrong = self._form(claim, camera)
        if wrong is not None:
            self.images.form.update(dict.fromkeys(claim.rows.tolist(), wrong))
            return
        if claim.encoding not in self._flaws:
            self._flaws[claim.encoding] = find_flaw(self._content, claim.encoding)
        if (flaw := self._flaws[claim.encoding]) is not None:
            flawed = self.images.form if flaw.is_of_form else self.images.damaged
            flawed.update(dict.fromkeys(claim.rows.tolist(), (flaw.expected, flaw.found)))
            return
        rows = claim.rows[self._chosen[claim.rows]]
        if len(rows):
            self._decode(rows, camera)

    def _form(self, claim: Claim, camera: Camera) -> tuple[str, str] | None:
        """Expected and found text where the header of an image is not that of its camera and encoding."""
        begin, header = self._headers.get(camera.name, (b"", None))
        if header is None or not self._content.startswith(begin):
            try:
                header = read_header(self._content)
            except DecodeError as error:
                return f"a {claim.encoding} of camera {camera.name}", str(error)
            expected = disagreement(header, camera)
            if expected is None and header.width_px * header.height_px > spec_limits().max_image_pixels:
                expected = f"at most {spec_limits().max_image_pixels:,} pixels"
            if expected is not None:
                return expected, str(header)
            self._headers[camera.name] = self._content[: header.num_bytes], header
        return (f"a {claim.encoding}", str(header)) if header.encoding != claim.encoding else None

    def _decode(self, rows: NDArray[np.int64], camera: Camera) -> None:
        images, is_map = self.images, camera.stream == SEMANTIC_STREAM
        images.is_decoded[rows] = True
        sight = self._sight(needs_pixels=is_map)
        if isinstance(sight, str):
            images.undecodable.update(dict.fromkeys(rows.tolist(), sight))
            return
        images.numbers[rows], has_one_colour = sight
        if not is_map or self._pixels is None:
            if has_one_colour:
                images.flat.update(rows.tolist())
            return
        unknown = unknown_class(self._pixels)
        for row in rows.tolist():
            if unknown is not None:
                images.maps["vehicles"].note(row, unknown)
                continue
            for look, comparison in self._looks:
                if look.is_judged[row]:
                    comparison.note(row, look(row, self._pixels))

    def _sight(self, *, needs_pixels: bool) -> _Sight:
        """What there is to see, with the pixels where they are needed and there are any."""
        sight = self._sights.get(self._digest)
        if sight is None or (needs_pixels and self._pixels is None and not isinstance(sight, str)):
            try:
                self._pixels = decode_image(self._content)
                sight = image_numbers(self._pixels), is_flat(self._pixels)
            except DecodeError as error:
                sight = str(error)
            if len(self._sights) >= _MAX_SIGHTS:
                self._sights.clear()
            self._sights[self._digest] = sight
        return sight
