"""Archives: one with all cases, and in it one with the files of all base datasets, which have much in common."""

from __future__ import annotations

import gzip
import io
import lzma
import tarfile
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from hashlib import sha256
from pathlib import Path

from branchdrive.contract.layout import unsafe_reason
from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.contract.text import quote
from branchdrive.errors import UsageError

__all__ = ["BASES_FILE", "base_files", "pack", "pack_bases", "unpacked"]

BASES_FILE = "bases/files.tar.xz"
"""The archive of the base datasets, in the folder of the cases."""


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


@cache
def base_files(folder: Path) -> dict[str, dict[str, bytes]]:
    """Files that base datasets have of their own, by base and path.

    Raises:
        UsageError: The folder holds no archive of them.
    """
    path, found = folder / BASES_FILE, dict[str, dict[str, bytes]]()
    try:
        with tarfile.open(path) as archive:
            for entry in archive:
                base, _, name = entry.name.partition("/")
                content = archive.extractfile(entry) if entry.isreg() else None
                if content is None or unsafe_reason(name) is not None:
                    raise UsageError(f"{path} holds {quote(entry.name)}, no plain file of a base dataset")
                found.setdefault(base, {})[name] = content.read()
    except (OSError, EOFError, lzma.LZMAError, tarfile.TarError) as error:
        raise UsageError(f"{path} is no archive of base datasets: {error}") from error
    return found


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """Folder of the cases in an archive, for as long as it is needed.

    Raises:
        UsageError: The file is no archive of cases of this version.
    """
    with tempfile.TemporaryDirectory(prefix="branchdrive-cases-") as scratch:
        try:
            with tarfile.open(path) as archive:
                for entry in archive:
                    content = archive.extractfile(entry) if entry.isreg() else None
                    if content is None or unsafe_reason(entry.name) is not None:
                        raise UsageError(f"--cases: {str(path)!r} holds {quote(entry.name)}, no plain file inside it")
                    target = Path(scratch) / entry.name
                    target.parent.mkdir(parents=True, exist_ok=True)
                    target.write_bytes(content.read())
        except (OSError, tarfile.TarError) as error:
            raise UsageError(f"--cases: {str(path)!r} is no archive of cases: {error}") from error
        folder = Path(scratch) / f"v{SPEC_VERSION}"
        if not (folder / "bases").is_dir():
            raise UsageError(f"--cases: {str(path)!r} holds no cases of version {SPEC_VERSION}")
        yield folder
