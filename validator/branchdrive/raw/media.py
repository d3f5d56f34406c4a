"""Images of a shard against their index: every image lies where the frames table says, with its checksum.

Source: spec/05-raw-streams.md#media.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from branchdrive.contract.columns import PATTERNS
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.mismatch import Location, Mismatch
from branchdrive.contract.text import quote
from branchdrive.errors import DatasetError
from branchdrive.formats.untrusted import Links, open_file

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["CHECKSUM_DIGITS", "media_mismatches"]

_FILE_NAME = re.compile(PATTERNS["file"].removeprefix("^").removesuffix("$"))

CHECKSUM_DIGITS = 16
"""Hexadecimal digits of an image's SHA-256 that the index records."""


def media_mismatches(
    root: Path, folder: str, files: Sequence[str], frames: pa.Table, links: Links = None
) -> Iterator[Mismatch]:
    """Images that are not where the index of the shard `folder` says, file by file.

    Args:
        root: The dataset folder.
        folder: The shard's folder, relative to the root.
        files: Regular files of the shard, relative to the root.
        frames: The shard's frames table with its declared columns.
        links: Folders that links may lead into.
    """
    listed = set(files)
    columns = ("file", "offset_bytes", "size_bytes", "checksum", "rollout_id", "tick")
    rows = zip(*(frames[name].to_pylist() for name in columns), strict=True)
    by_file: dict[str, list[tuple[int, int, str, str, int]]] = {}
    for name, offset, size, checksum, rollout_id, tick in rows:
        if None in (name, offset, size, checksum, rollout_id, tick) or not _FILE_NAME.fullmatch(name):
            continue  # nulls and unsafe names are reported by other rules
        by_file.setdefault(f"{folder}/{name}", []).append((offset, size, checksum, rollout_id, tick))
    for path, images in sorted(by_file.items()):
        if path not in listed:
            yield Mismatch({"file": path}, "a file of the shard", "no such file", len(images))
            continue
        try:
            yield from _of_file(root, path, images, links)
        except (DatasetError, OSError) as error:
            yield Mismatch({"file": path}, "a file that can be read", str(error), len(images))


def _of_file(root: Path, path: str, images: list[tuple[int, int, str, str, int]], links: Links) -> Iterator[Mismatch]:
    max_bytes = spec_limits().max_image_bytes
    with open_file(root, path, links) as stream:
        for offset, size, checksum, rollout_id, tick in sorted(images):
            place: Location = {"file": path, "table": "frames", "rollout_id": rollout_id, "tick": tick}
            if not (offset >= 0 and 0 < size <= max_bytes):
                yield Mismatch(place, f"1 .. {max_bytes} bytes of the file", f"{size} bytes from {offset}")
                continue
            stream.seek(offset)
            content = stream.read(size)
            digest = hashlib.sha256(content).hexdigest()[:CHECKSUM_DIGITS]
            if len(content) < size:
                yield Mismatch(place, f"{size} bytes from {offset}", f"{len(content)} bytes: the file ends")
            elif digest != checksum:
                yield Mismatch(place, f"checksum {digest}", quote(checksum))
