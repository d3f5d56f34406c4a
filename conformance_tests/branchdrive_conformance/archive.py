"""Archives: one with all cases, and in it one with the files of all base datasets, which have much in common."""

from __future__ import annotations

import lzma
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from branchdrive.contract.layout import unsafe_reason
from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.contract.text import quote
from branchdrive.errors import UsageError

__all__ = ["BASES_FILE", "base_files", "unpacked"]

BASES_FILE = "bases/files.tar.xz"
"""The archive of the base datasets, in the folder of the cases."""


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
