"""A finished dataset: one whose descriptor and manifest are both in place."""

from __future__ import annotations

from pathlib import Path

from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE
from branchdrive.errors import UsageError
from branchdrive.raw.reader import Dataset, open_dataset

__all__ = ["open_finished"]


def open_finished(root: Path) -> Dataset:
    """Open the finished dataset in the folder `root`.

    Raises:
        UsageError: The folder holds none.
        DatasetError: Its descriptor or layout cannot be read safely.
    """
    for name in (DESCRIPTOR_FILE, MANIFEST_FILE):
        if not (root / name).is_file():
            raise UsageError(f"{str(root)!r} holds no finished dataset: there is no {name!r}")
    return open_dataset(root)
