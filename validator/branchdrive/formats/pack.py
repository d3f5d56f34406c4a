"""A finished dataset as one archive: stored members in the order of the manifest, which comes last.

Equal datasets give equal bytes: names, times and modes follow from nothing else. Every file is held against its digest
while it is written.

Source: spec/03-layout.md#archives.
"""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats import archive as form
from branchdrive.formats.durable import durable_stream, move, partial_path
from branchdrive.formats.manifest import sound_manifest
from branchdrive.formats.store import Store

__all__ = ["PackReport", "pack_dataset"]

WIDE_FROM = form.FULL_32
"""Sizes and places from here on are written as 64-bit numbers."""

_FIRST_DAY = 1 << 5 | 1
"""1 January 1980, when time begins in an archive."""

_MODE = 0o100644
_PIECE_BYTES = 1 << 20
_CRC_AT = 14
_VERSION, _VERSION_64 = 20, 45


@dataclass(frozen=True)
class PackReport:
    """What was packed.

    Attributes:
        num_files: Members.
        num_bytes: Bytes of the archive.
        identity: Identity of the dataset.
    """

    num_files: int
    num_bytes: int
    identity: str


def pack_dataset(dataset: Store, output: Path, progress: Callable[[int, int], None] = lambda *_: None) -> PackReport:
    """Write a finished dataset into one archive, which appears whole or not at all.

    Args:
        dataset: The dataset.
        output: The archive, which must not be there.
        progress: Called with the number of files that are written, and of all.

    Raises:
        UsageError: There is something at `output`, or its name does not end as that of an archive.
        DatasetError: The dataset is not finished, or is not what its manifest says.
    """
    if output.suffix != form.ARCHIVE_NAME:
        raise UsageError(f"{str(output)!r} is no name of an archive; let it end in {form.ARCHIVE_NAME!r}")
    if output.exists() or output.is_symlink():
        raise UsageError(f"{str(output)!r} is there already; name a new file")
    manifest = sound_manifest(dataset)
    partial = partial_path(output)
    try:
        with durable_stream(partial) as stream:
            writer = _Writer(dataset, stream)
            for done, path in enumerate(sorted(manifest.files)):
                progress(done, len(manifest.files))
                digest = writer.add(path)
                if digest != manifest.files[path]:
                    raise DatasetError(f"{dataset}: {path!r} is not the file that {MANIFEST_FILE} lists; restore it")
            writer.add(MANIFEST_FILE)
            writer.end()
            num_bytes = stream.tell()
        move(partial, output)
    except BaseException:
        with suppress(OSError):
            partial.unlink()
        raise
    return PackReport(len(manifest.files) + 1, num_bytes, manifest.identity)


class _Writer:
    """An archive while it is written.

    Args:
        dataset: Where members come from.
        stream: Where it goes.
    """

    def __init__(self, dataset: Store, stream: BinaryIO) -> None:
        self._dataset, self._stream = dataset, stream
        self._directory = bytearray()
        self._count = 0

    def add(self, path: str) -> str:
        """Write a file; returns its SHA-256."""
        name, header = path.encode("utf-8"), self._stream.tell()
        found = self._dataset.status(path)
        size = 0 if found is None else found.size
        extra = _wide_extra(size, size) if size >= WIDE_FROM else b""
        shown = form.FULL_32 if extra else size
        flags = 0 if path.isascii() else form.FLAG_UTF8
        version = _VERSION_64 if extra else _VERSION
        self._stream.write(
            form.LOCAL.pack(form.LOCAL_MARK, version, flags, 0, 0, _FIRST_DAY, 0, shown, shown, len(name), len(extra))
        )
        self._stream.write(name + extra)
        crc, digest = self._copy(path, size)
        end = self._stream.tell()
        self._stream.seek(header + _CRC_AT)
        self._stream.write(struct.pack("<L", crc))
        self._stream.seek(end)
        self._list(name, flags, crc, size, header)
        return digest

    def _copy(self, path: str, size: int) -> tuple[int, str]:
        """Copy a file; returns its checksum and SHA-256."""
        crc, digest, copied = 0, hashlib.sha256(), 0
        with self._dataset.open(path) as source:
            while piece := source.read(_PIECE_BYTES):
                crc, copied = zlib.crc32(piece, crc), copied + len(piece)
                digest.update(piece)
                self._stream.write(piece)
        if copied != size:
            raise DatasetError(f"{self._dataset}: {path!r} was changed while it was packed; pack again")
        return crc, digest.hexdigest()

    def _list(self, name: bytes, flags: int, crc: int, size: int, header: int) -> None:
        """Add a member to the directory."""
        wide_size, wide_header = size >= WIDE_FROM, header >= WIDE_FROM
        extra = _wide_extra(*([size, size] * wide_size), *([header] * wide_header))
        version = _VERSION_64 if extra else _VERSION
        shown = form.FULL_32 if wide_size else size
        self._directory += form.CENTRAL.pack(
            form.CENTRAL_MARK, form.UNIX << 8 | version, version, flags, 0, 0, _FIRST_DAY, crc, shown, shown, len(name),
            len(extra), 0, 0, 0, _MODE << 16, form.FULL_32 if wide_header else header,
        )  # fmt: skip
        self._directory += name + extra
        self._count += 1

    def end(self) -> None:
        """Write the directory."""
        start, length, count = self._stream.tell(), len(self._directory), self._count
        self._stream.write(self._directory)
        if count >= form.FULL_16 or max(start, length) >= WIDE_FROM:
            made_by, rest = form.UNIX << 8 | _VERSION_64, form.END_64.size - 12
            self._stream.write(
                form.END_64.pack(form.END_64_MARK, rest, made_by, _VERSION_64, 0, 0, count, count, length, start)
            )
            self._stream.write(form.LOCATOR_64.pack(form.LOCATOR_64_MARK, 0, start + length, 1))
            count, length, start = form.FULL_16, form.FULL_32, form.FULL_32
        self._stream.write(form.END.pack(form.END_MARK, 0, 0, count, count, length, start, 0))


def _wide_extra(*numbers: int) -> bytes:
    """The extra field with 64-bit numbers; none without numbers."""
    content = struct.pack(f"<{len(numbers)}Q", *numbers)
    return form.EXTRA.pack(form.EXTRA_64, len(content)) + content if numbers else b""
