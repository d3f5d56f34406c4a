"""Images of small datasets: a few pixels each, all different, in an archive, or one after the other in a plain file.

Attempts of a group see the same before their branch, and each something else after it; groups see the same.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Collection, Mapping, Sequence
from functools import cache
from io import BytesIO
from typing import Any
from zlib import adler32, crc32

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from branchdrive.contract.columns import STREAMS
from branchdrive.contract.timing import FUTURE_OFFSETS, HISTORY_OFFSETS
from branchdrive.formats.media_archive import MEDIA_FILE as ARCHIVE_FILE
from branchdrive.formats.media_archive import MediaArchive, member_name

__all__ = [
    "ARCHIVE_FILE", "IMAGE_PX", "MEDIA_FILE", "SURROUND", "archived", "frame_columns", "media_bytes", "media_document",
    "png", "view",
]  # fmt: skip

MEDIA_FILE = "media.bin"
"""Plain file of a shard that holds each of its images once."""

IMAGE_PX = (8, 4)
"""Columns and rows of an image."""

SURROUND = "rgb_surround"
"""The stream that small datasets claim by default."""


def png(pixels: NDArray[np.uint8]) -> bytes:
    """PNG of pixels ``[rows, columns, 3]`` or ``[rows, columns]``, not compressed: the same bytes on every machine."""
    height, width = pixels.shape[:2]
    rows = b"".join(b"\x00" + row.tobytes() for row in pixels)
    pieces = [rows[start : start + 0xFFFF] for start in range(0, len(rows), 0xFFFF)]
    blocks = (
        struct.pack("<BHH", number == len(pieces), len(piece), 0xFFFF - len(piece)) + piece
        for number, piece in enumerate(pieces, 1)
    )
    data = b"\x78\x01" + b"".join(blocks) + adler32(rows).to_bytes(4, "big")
    header = struct.pack(">IIBBBBB", width, height, 8, 2 if pixels.ndim == 3 else 0, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", data), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + crc32(kind + body).to_bytes(4, "big") for kind, body in chunks
    )


@cache
def view(number: int) -> bytes:
    """Image of a number, below 2 ** 23: every one has other bytes, and all are equally long."""
    columns, rows = np.meshgrid(np.arange(IMAGE_PX[0]), np.arange(IMAGE_PX[1]))
    digits = (number % 251, number // 251 % 251, number // 251**2)
    ramps = (5 * columns, 7 * rows, 3 * (columns + rows))
    return png(np.stack([(d + ramp) % 256 for d, ramp in zip(digits, ramps, strict=True)], axis=2).astype(np.uint8))


def media_bytes(frames: pa.Table) -> bytes:
    """Content of the file that an index of `frame_columns` names, up to its last image."""
    size = len(view(0))
    own = frames.filter(pc.equal(frames["size_bytes"], size))
    last = pc.max(own["offset_bytes"]).as_py()
    return b"".join(view(number) for number in range(0 if last is None else last // size + 1))


def archived(frames: pa.Table) -> tuple[pa.Table, bytes]:
    """An index of `frame_columns` and the archive of its images, a member for each row."""
    stream, rows = BytesIO(), frames.to_pylist()
    archive = MediaArchive(stream)
    for row in rows:
        image = view(row["offset_bytes"] // len(view(0)))
        name = member_name(row["rollout_id"], row["tick"], row["camera"], row["encoding"])
        row |= {"file": ARCHIVE_FILE, "offset_bytes": archive.add(name, image)}
    archive.end()
    return pa.Table.from_pylist(rows, frames.schema), stream.getvalue()


def frame_columns(
    rollouts: pa.Table,
    *,
    cameras: Sequence[str] = STREAMS[SURROUND].cameras,
    roles: Collection[str] = ("nominal", "intervention", "nominal_replay"),
    offsets: Sequence[int] = (*HISTORY_OFFSETS, *FUTURE_OFFSETS),
) -> dict[str, Any]:
    """Index of an image of every camera at saved observations around the branch.

    Args:
        rollouts: The attempts, those of a group one after the other.
        cameras: Names of the cameras.
        roles: Roles of the attempts that have images.
        offsets: Ticks from the branch.
    """
    size = len(view(0))
    past, future = ([offset for offset in offsets if (offset > 0) == later] for later in (False, True))
    place = {offset: i for of in (past, future) for i, offset in enumerate(of)}
    columns: dict[str, list[Any]] = {name: [] for name in ("rollout_id", "tick", "camera", "offset_bytes", "checksum")}
    number_in: dict[str, int] = {}
    for row in rollouts.select(["rollout_id", "group_id", "role", "branch_tick", "num_ticks"]).to_pylist():
        if row["role"] not in roles or row["branch_tick"] is None:
            continue
        number = number_in[row["group_id"]] = number_in.get(row["group_id"], -1) + 1
        for offset in offsets:
            tick = row["branch_tick"] + offset
            if not 0 <= tick < row["num_ticks"]:
                continue
            moment = place[offset] if offset <= 0 else len(past) + number * len(future) + place[offset]
            for k, camera in enumerate(cameras):
                image = moment * len(cameras) + k
                values = (row["rollout_id"], tick, camera, size * image, _checksum(image))
                for name, value in zip(columns, values, strict=True):
                    columns[name].append(value)
    num_rows = len(columns["tick"])
    constant = {"file": MEDIA_FILE, "size_bytes": size, "encoding": "png"}
    return {**columns, **{name: [value] * num_rows for name, value in constant.items()}}


@cache
def _checksum(number: int) -> str:
    return hashlib.sha256(view(number)).hexdigest()[:16]


def media_document(document: Mapping[str, Any], stream: str = SURROUND) -> dict[str, Any]:
    """A descriptor that claims a stream of RGB images as well, with its cameras."""
    lens = {"projection": "pinhole", "fx_px": 4.0, "fy_px": 4.0, "cx_px": 4.0, "cy_px": 2.0}
    pose = {"x_m": 1.0, "y_m": 0.0, "z_m": 1.5, "yaw_rad": 0.0, "pitch_rad": 0.0}
    image = {"stream": stream, "width_px": IMAGE_PX[0], "height_px": IMAGE_PX[1]}
    cameras = [{"name": name, **image, **lens, **pose} for name in STREAMS[stream].cameras]
    return {**document, "streams": [*document["streams"], stream], "cameras": cameras}
