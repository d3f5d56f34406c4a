"""Encoded images on disk, under the digests of the images and of their encoder.

A file holds what one group has of one input, as a plain array of numpy without pickled objects. Its name is the SHA-256
of the encoder's digest and of the checksums of the images, by step and camera: other images, another order or another
encoder, of which another library that decodes or another version of it is one, have another name. Nothing else makes a
file out of date but another processor, for the last bits of features of a network. A file that cannot be read counts as
none, and one that cannot be written is left out.

Source: this project's choice.
"""

from __future__ import annotations

import hashlib
import io
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.formats.durable import write_file
from branchdrive.formats.folder import Folder
from branchdrive.formats.store import Store

__all__ = ["FeatureCache", "features_key"]


class FeatureCache:
    """A folder of encoded images, which several processes may use at once; it can be deleted at any time.

    Args:
        folder: Where they are; nothing is kept where there is none.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    @classmethod
    def beside(cls, release: Store) -> FeatureCache:
        """The folder for a release, with its name and ``.features`` behind: beside it, and no part of it.

        There is none beside a release that lies elsewhere than in a folder.
        """
        if not isinstance(release, Folder):
            return cls(None)
        root = release.root.resolve()
        return cls(root.with_name(f"{root.name}.features"))

    def get(self, key: str, shape: tuple[int, ...], dtype: str) -> NDArray[Any] | None:
        """The array of a key; ``None`` where there is none of that shape and type."""
        if self._folder is None:
            return None
        try:
            found = np.load(_path(self._folder, key), allow_pickle=False)
        except (OSError, EOFError, ValueError):
            return None
        return found if isinstance(found, np.ndarray) and (found.shape, found.dtype) == (shape, dtype) else None

    def put(self, key: str, values: NDArray[Any]) -> None:
        """Keep an array where the folder can be written; a reader sees all of it or nothing."""
        if self._folder is None:
            return
        path, stream = _path(self._folder, key), io.BytesIO()
        np.save(stream, values, allow_pickle=False)
        partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
        with suppress(OSError):
            path.parent.mkdir(exist_ok=True)
            try:
                write_file(partial, stream.getbuffer())
                partial.replace(path)
            finally:
                partial.unlink(missing_ok=True)


def _path(folder: Path, key: str) -> Path:
    return folder / f"{key}.npy"


def features_key(encoder: str, checksums: NDArray[np.object_]) -> str:
    """Name of the encoded images of a group.

    Args:
        encoder: Digest of the encoder.
        checksums: Checksums of the images, ``[16, cameras]``, empty where there is none.
    """
    lines = [encoder, *(f"{place} {checksum}" for place, checksum in np.ndenumerate(checksums))]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()
