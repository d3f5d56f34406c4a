"""What no validator does without: read every file of a layer, hash it, decode every table, and images where it must.

Workers import this module for their tasks, and it imports nothing but the core: a floor that waited for the reference
world would flatter what is compared with it.
"""

from __future__ import annotations

import hashlib
import io
import tarfile
from collections.abc import Iterator
from pathlib import Path

from branchdrive.contract.layer import LAYERS
from branchdrive.contract.layout import RAW_DIR
from branchdrive.formats.image_codec import decode_image
from branchdrive.formats.untrusted_parquet import decode_table

__all__ = ["layer_folders", "read_folder"]


def layer_folders(root: Path) -> list[Path]:
    """Shards and derived layers of a dataset."""
    layers = [root / name for name in LAYERS]
    return [*sorted((root / RAW_DIR).iterdir()), *(layer for layer in layers if layer.is_dir())]


def read_folder(folder: Path) -> int:
    """Read, hash and decode all of a shard or a layer.

    Returns:
        Rows of controls.
    """
    num_rows = 0
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        content = path.read_bytes()
        hashlib.sha256(content).hexdigest()
        if path.suffix == ".parquet":
            table = decode_table(content, path.stem)
            num_rows += table.num_rows if path.stem == "controls" else 0
        elif path.suffix == ".tar":
            for image in _members(content):
                decode_image(image)
    return num_rows


def _members(content: bytes) -> Iterator[bytes]:
    with tarfile.open(fileobj=io.BytesIO(content)) as archive:
        for member in archive:
            stream = archive.extractfile(member)
            if stream is not None:
                yield stream.read()
