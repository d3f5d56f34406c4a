"""Small images beside a release of `tests.model_release`: six views and a bird's-eye view of every observation.

Every group has a number in [0, 1] that its pictures show and nothing else tells: how bright the last views are, and how
far other vehicles stand in the last bird's-eye views.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from branchdrive.contract.columns import STREAMS
from branchdrive.contract.document import dump_json, parse_json
from branchdrive.contract.semantic_bev import SemanticChannel, SemanticClass
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.formats.parquet import encode_table
from branchdrive.formats.table_file import parts_of
from branchdrive.tables.arrow import to_arrow
from branchdrive.tables.frame import Values
from branchdrive.testing.dataset import media_document

__all__ = ["MEDIA", "SHARD", "add_images", "bev_camera", "png", "semantic_view", "shown_number"]

SHARD, MEDIA = "raw/shard-00000", "media.tar"
"""Folder of the images, and their file: one after the other, which the index alone takes apart."""

_STREAMS = ("rgb_surround", "semantic_bev")
_SIDE = 256


def shown_number(group: str) -> float:
    """What the pictures of a group show."""
    return int(hashlib.sha256(group.encode()).hexdigest()[:6], 16) / 0xFFFFFF


def png(pixels: Any) -> bytes:
    """Pixels as a PNG, quickly."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG", compress_level=1)
    return stream.getvalue()


def semantic_view(number: float) -> Any:
    """A road along the middle, the ego on it, and a vehicle ahead at a distance that tells the number."""
    pixels = np.zeros((_SIDE, _SIDE), np.uint8)
    pixels[:, 118:138] = SemanticClass.ROAD | SemanticChannel.DRIVABLE_AREA
    pixels[:128, 127:129] |= np.uint8(SemanticChannel.REMAINING_ROUTE)
    pixels[123:133, 126:130] = SemanticClass.VEHICLE | SemanticChannel.DRIVABLE_AREA | SemanticChannel.EGO
    row = 110 - round(100 * number)
    pixels[row : row + 10, 126:130] = (
        SemanticClass.VEHICLE | SemanticChannel.DRIVABLE_AREA | SemanticChannel.OTHER_VEHICLE
    )
    return pixels


def bev_camera() -> dict[str, Any]:
    """The camera of bird's-eye views as a descriptor declares it."""
    return {
        "name": "bev", "stream": "semantic_bev", "projection": "top_down", "width_px": _SIDE, "height_px": _SIDE,
        "px_per_m": 2.0, "origin_row_px": 128.0, "origin_column_px": 128.0,
    }  # fmt: skip


def add_images(root: Path, partitions: Mapping[str, str], streams: tuple[str, ...] = _STREAMS) -> Path:
    """Put images beside the release in `root`: of the groups in `partitions`, which gives the partition of each."""
    document = parse_json((root / "branchdrive.json").read_bytes())
    document = media_document(document)
    document["streams"] = [name for name in STREAMS if name in document["streams"] or name in streams]
    document["streams"] = [name for name in document["streams"] if not STREAMS[name].cameras or name in streams]
    if "semantic_bev" in streams:
        document["cameras"] = [*document["cameras"], bev_camera()]
    document["cameras"] = [camera for camera in document["cameras"] if camera["stream"] in streams]
    (root / "branchdrive.json").write_bytes(dump_json(document))
    rows: list[tuple[Any, ...]] = []
    folder = root / SHARD
    folder.mkdir(parents=True)
    with (folder / MEDIA).open("wb") as media:
        for group, partition in partitions.items():
            for camera, offset, content in _images(group, streams):
                digest = hashlib.sha256(content).hexdigest()[:16]
                place = (f"{group}.nominal.a1", SHARD, MEDIA, media.tell(), len(content), digest, "png")
                rows.append((group, partition, camera, offset, *place))
                media.write(content)
    frame = _frame(rows)
    for path, part in parts_of("media_index", to_arrow("media_index", frame)).items():
        (root / path).write_bytes(encode_table(part))
    return root


def _images(group: str, streams: tuple[str, ...]) -> Any:
    """Camera, offset and bytes of every image of a group: noise, and the number in the last observations."""
    number, rng = shown_number(group), np.random.default_rng(len(group))
    for offset in HISTORY_OFFSETS:
        tells = number if offset > HISTORY_OFFSETS[8] else 0.5
        if "rgb_surround" in streams:
            for camera in STREAMS["rgb_surround"].cameras:
                noise = rng.integers(0, 60, (9, 16, 3), np.uint8)
                yield camera, offset, png(noise + np.uint8(round(190 * tells)))
        if "semantic_bev" in streams:
            yield "bev", offset, png(semantic_view(tells))


def _frame(rows: list[tuple[Any, ...]]) -> dict[str, Values]:
    names = (
        "group_id", "partition", "camera", "offset_ticks", "rollout_id", "shard", "file", "offset_bytes", "size_bytes",
        "checksum", "encoding",
    )  # fmt: skip
    kinds: dict[str, Any] = {"offset_ticks": np.int32, "offset_bytes": np.int64, "size_bytes": np.int64}
    return {name: np.array([row[i] for row in rows], kinds.get(name, object)) for i, name in enumerate(names)}
