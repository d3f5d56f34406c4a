"""A dataset in other places than a folder."""

from __future__ import annotations

import zipfile
from pathlib import Path

__all__ = ["files_of", "packed"]


def files_of(folder: Path) -> dict[str, bytes]:
    """Content of every file below a folder, by path."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def packed(folder: Path, path: Path) -> Path:
    """An archive of the files of a folder, whatever they are."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files_of(folder).items():
            archive.writestr(name, content)
    return path
