"""Media files of a shard: digested and compared with the index in one pass, and their images looked at on the way.

Every byte is read once; no more than a part of a file and one image are held.

Source: spec/05-raw-streams.md#media.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

from branchdrive.contract.camera import Camera
from branchdrive.contract.columns import TABLES
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.media import MediaMode
from branchdrive.contract.mismatch import MAX_KEPT, Mismatch, Mismatches
from branchdrive.errors import DatasetError
from branchdrive.formats.file_part import FilePart
from branchdrive.formats.store import Store, size_of
from branchdrive.raw.media.archive_walk import ARCHIVE_SUFFIX, ArchiveWalk
from branchdrive.raw.media.image_claims import ImageClaims
from branchdrive.raw.media.image_eye import ImageEye, Look
from branchdrive.raw.media.images import Images

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["MediaReading", "read_media"]

_MAX_OVERLAP = 2
"""How often the bytes of a file are looked at as images, on average: ranges that overlap cost as if they did not."""

_NO_LOOKS: Mapping[str, Look] = MappingProxyType({})

_HEAD_BYTES = 4
"""First bytes that tell of code."""

_HEADS: Mapping[bytes, str] = MappingProxyType(
    {
        **{bytes([0x80, protocol]): "a pickle" for protocol in range(2, 6)},
        b"\x7fELF": "a program",
        b"MZ\x90\x00": "a program",
        b"\xcf\xfa\xed\xfe": "a program",
        b"\xce\xfa\xed\xfe": "a program",
        b"\xca\xfe\xba\xbe": "a program",
        b"#!/": "a script",
    }
)
"""First bytes of files that hold code: pickles, whose reading executes what they store, programs and scripts.

Source: spec/09-security.md#serialisation.
"""

_PICKLE_SUFFIXES = (".pkl", ".pickle", ".joblib", ".pt", ".pth")
"""Names that people give pickles, which need not begin with such bytes."""


@dataclass(eq=False)
class MediaReading:
    """What became of the media files of a shard.

    Attributes:
        digests: SHA-256 of the files that are digested here.
        unreadable: Why files could not be read.
        over_limit: How files exceed the limits.
        stored_code: Files that hold code, and of which kind.
        mismatches: Images that are not where the index says, by file.
        archives: What archives hold but the images that the index names, by file.
        num_images: Rows of the index that were looked at.
        images: What the images say; ``None`` where the shard has no index that can be read.
    """

    digests: dict[str, str] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)
    over_limit: dict[str, str] = field(default_factory=dict)
    stored_code: dict[str, str] = field(default_factory=dict)
    mismatches: dict[str, Mismatches] = field(default_factory=dict)
    archives: dict[str, Mismatches] = field(default_factory=dict)
    num_images: int = 0
    images: Images | None = None


def read_media(
    dataset: Store,
    folder: str,
    files: Collection[str],
    frames: pa.Table | None,
    cameras: Mapping[str, Camera],
    *,
    media: Collection[str] = (),
    mode: MediaMode = "full",
    is_hashed: bool = True,
    looks: Mapping[str, Look] = _NO_LOOKS,
) -> MediaReading:
    """Read the media files of a shard.

    Args:
        dataset: The dataset.
        folder: The shard's folder, relative to the root.
        files: Its regular files, relative to the root.
        media: Those of them that are no tables.
        frames: Its media index with the declared columns; ``None`` if it has none that can be read.
        cameras: Cameras of the descriptor by name.
        mode: Which images are decoded.
        is_hashed: Whether what is no table is digested.
        looks: Called with the pixels of every decoded semantic map that they judge, by part of `MAP_PARTS`.
    """
    reading, eye = MediaReading(), None
    if frames is not None:
        claims = ImageClaims(frames)
        excess = claims.excess(cameras)
        if excess is None:
            eye = ImageEye(frames, claims, cameras, mode, looks)
            reading.images, reading.num_images = eye.images, frames.num_rows
        else:
            reading.over_limit[f"{folder}/{TABLES['frames'].file_name}"] = excess
            reading.images = Images.none(frames.num_rows)
            reading.images.unjudged = f"the media index {excess}"
    named = {} if eye is None else {f"{folder}/{name}": num_rows for name, num_rows in eye.claims.num_rows.items()}
    for path, num_rows in _missing(named, files):
        lacking = Mismatch({"file": path}, "a file of the shard", "no such file", num_rows)
        reading.mismatches.setdefault(path, Mismatches()).add(lacking)
    for path in sorted({*named, *media} & {*files}):
        is_digested = is_hashed and path in media
        try:
            with dataset.open(path) as stream:
                num_bytes = size_of(stream)
                if is_digested and num_bytes > spec_limits().max_media_bytes:
                    reading.over_limit[path] = f"has more than {spec_limits().max_media_bytes} bytes, the limit"
                part = FilePart(stream, is_digested and path not in reading.over_limit)
                if path in media and (kind := _stored_code(path, part.bytes_at(0, _HEAD_BYTES))):
                    reading.stored_code[path] = kind
                if eye is not None:
                    _look(path, part, num_bytes, eye, reading)
                if part.digest is not None:
                    reading.digests[path] = part.finish()
        except (DatasetError, OSError) as error:
            if is_digested:
                reading.unreadable[path] = str(error)
            if path in named:
                found = reading.mismatches.setdefault(path, Mismatches())
                found.add(Mismatch({"file": path}, "a file that can be read", str(error), named[path]))
    return reading


def _missing(named: Mapping[str, int], files: Collection[str]) -> Iterator[tuple[str, int]]:
    """Files that an index names and that are not there, with their rows; of a million, the last stands for the rest."""
    missing = sorted({*named} - {*files})
    for number, path in enumerate(missing):
        yield missing[min(number, MAX_KEPT)], named[path]


def _look(path: str, part: FilePart, num_bytes: int, eye: ImageEye, reading: MediaReading) -> None:
    """Look at the images that an index names in a file, and at everything else in an archive."""
    claims, name = eye.claims, path.rpartition("/")[2]
    found = reading.mismatches.setdefault(path, Mismatches())
    indexed = claims.num_bytes(name, num_bytes)
    if indexed > _MAX_OVERLAP * num_bytes:
        expected = f"ranges of at most {_MAX_OVERLAP} x {num_bytes} bytes together"
        there = f"ranges that overlap: {indexed} bytes"
        found.add(Mismatch({"file": path}, expected, there, claims.num_rows[name]))
        return
    walk = None
    if name.endswith(ARCHIVE_SUFFIX):
        walk = ArchiveWalk(path, part, reading.archives.setdefault(path, Mismatches()))
    for place in claims.places(name):
        if walk is not None:
            keys = [claims.key(row) for claim in place.claims for row in claim.rows.tolist()]
            walk.member(place.offset, place.size, keys, place.claims[0].encoding)
        eye.see(path, place, part, found)
    if walk is not None:
        walk.end(num_bytes)


def _stored_code(name: str, head: bytes) -> str | None:
    """What kind of code a file holds, by its name and its first `_HEAD_BYTES`; ``None`` where these tell of none."""
    if name.lower().endswith(_PICKLE_SUFFIXES):
        return "a pickle"
    return next((kind for start, kind in _HEADS.items() if head.startswith(start)), None)
