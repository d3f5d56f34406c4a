"""Where a command may write: checked before the dataset is read, not after the work is done."""

from __future__ import annotations

import os
from pathlib import Path

from branchdrive.errors import UsageError

__all__ = ["check_output"]


def check_output(path: Path | None, *, outside: Path | str | None = None, is_folder: bool = False) -> None:
    """Refuse an `--output` that cannot be written, or that would become part of the dataset that is read.

    Args:
        path: What the user gave; ``None``, the terminal, is always fine.
        outside: Folder of a dataset. Every file in it must be in its manifest, so a new one would break it. At a URL,
            no file of this machine lies.
        is_folder: Whether a folder is wanted, which may still have to be made, and not a file in one that exists.

    Raises:
        UsageError: With the reason.
    """
    if path is None:
        return
    place = _existing_folder(path) if is_folder else path.parent
    if is_folder and not place.is_dir():
        raise UsageError(f"--output: {str(place)!r} is not a folder")
    if not place.is_dir():
        raise UsageError(f"--output: folder {str(place)!r} does not exist")
    if not is_folder and path.is_dir():
        raise UsageError(f"--output: {str(path)!r} is a folder; name a file")
    if not is_folder and os.path.lexists(path) and (path.is_symlink() or not path.is_file()):
        raise UsageError(  # a file is replaced by renaming another one over it, which would end a device or a link
            f"--output: {str(path)!r} is not a regular file; name a file, or leave --output out and redirect"
        )
    if isinstance(outside, Path) and _is_dataset(outside) and _lies_in(place, outside):
        raise UsageError(
            f"--output: {str(path)!r} lies inside the dataset {str(outside)!r}, which would not be valid with "
            "files of others; name a place outside it"
        )
    if not os.access(place, os.W_OK):
        raise UsageError(f"--output: folder {str(place)!r} is not writable")


def _existing_folder(path: Path) -> Path:
    """`path`, or the nearest thing above it that exists; a link that leads nowhere counts as existing."""
    while not os.path.lexists(path) and path != path.parent:
        path = path.parent
    return path


def _is_dataset(root: Path) -> bool:
    """Whether the folder `root` holds anything that belongs to a dataset, finished or not."""
    from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE, RAW_DIR

    return any((root / name).exists() for name in (DESCRIPTOR_FILE, MANIFEST_FILE, RAW_DIR))


def _lies_in(place: Path, root: Path) -> bool:
    """Whether the folder `place` is `root` or below it, whatever links lead there."""
    real = place.resolve()
    return any(folder.samefile(root) for folder in (real, *real.parents))
