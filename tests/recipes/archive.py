"""Writes the archives that `branchdrive_conformance.archive` reads: of all cases, and of the files of all bases."""

from __future__ import annotations

import gzip
import io
import lzma
import tarfile
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path

__all__ = ["pack", "pack_bases"]


def pack(folder: Path, target: Path) -> str:
    """Write all files below `folder` into one archive, and its digest into a file beside it.

    Equal files give an equal archive with one version of zlib.

    Returns:
        SHA-256 of the archive, hexadecimal.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    packed = _packed({path.relative_to(folder.parent).as_posix(): path.read_bytes() for path in files})
    target.write_bytes(gzip.compress(packed, mtime=0))
    digest = sha256(target.read_bytes()).hexdigest()
    target.with_name(f"{target.name}.sha256").write_text(f"{digest}  {target.name}\n", encoding="utf-8")
    return digest


def _packed(files: Mapping[str, bytes]) -> bytes:
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for path, content in files.items():
            entry = tarfile.TarInfo(path)
            entry.size, entry.mode = len(content), 0o644
            archive.addfile(entry, io.BytesIO(content))
    return packed.getvalue()


def pack_bases(files: Mapping[str, Mapping[str, bytes]]) -> bytes:
    """The archive of the files that base datasets have of their own, by base and path."""
    paths = {f"{base}/{path}": own[path] for base, own in files.items() for path in sorted(own)}
    return lzma.compress(_packed(paths), preset=9 | lzma.PRESET_EXTREME)
