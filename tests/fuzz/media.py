"""Damage of images, of archives and of what an index says of them: what costs a reader much, hides, or is misread."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
from tests.archives import FOREIGN, HOSTILE
from tests.fuzz.damage import put
from tests.fuzz.draw import Draw
from tests.slow_images import slow_jpeg
from tests.validator.engine.datasets import parquet_bytes
from tests.validator.formats.test_image_parts import DAMAGED, OF_FORM, TURNED

from branchdrive.contract.layout import DESCRIPTOR_FILE
from branchdrive.formats.media_archive import member_name
from branchdrive.formats.untrusted_parquet import decode_table

__all__ = ["damage_media"]

Edit = Callable[[Draw, Path, list[dict[str, Any]]], str]
"""Damages the media of a shard and rows of its index, in place, and says how."""

SLOW_PX = 2048
MAX_SLOW = 40
MANY_ROWS = (65, 2000, 200_000)


def _archive(draw: Draw, shard: Path, rows: list[dict[str, Any]]) -> str:
    """The images of a file in an archive that hides something, or in one of another program."""
    kind, write = draw.choice([*HOSTILE.items(), *FOREIGN.items()])
    file = draw.choice(sorted({row["file"] for row in rows}))
    stored = (shard / file).read_bytes()
    own = [row for row in rows if row["file"] == file]
    images = [
        (member_name(row["rollout_id"], row["tick"], row["camera"], row["encoding"]),
         stored[row["offset_bytes"] : row["offset_bytes"] + row["size_bytes"]])
        for row in own
    ]  # fmt: skip
    content, offsets = write(images)
    for row, offset in zip(own, offsets, strict=True):
        row["offset_bytes"] = offset
    put(shard / file, content)
    return f"{file}: {kind}"


def _image(draw: Draw, shard: Path, rows: list[dict[str, Any]]) -> str:
    """An image that some programs turn, or read otherwise than others, or that lacks some of its bytes."""
    kind, content = draw.choice([*TURNED.items(), *OF_FORM.items(), *DAMAGED.items()])
    row = draw.choice(rows)
    _name(row, "odd.bin", 0, content)
    put(shard / "odd.bin", content)
    return f"an image: {kind}"


def _many_rows(draw: Draw, shard: Path, rows: list[dict[str, Any]]) -> str:
    """Rows that name one range."""
    count, row = draw.choice(MANY_ROWS), draw.choice(rows)
    rows += [row] * count
    return f"{count} rows of one range"


def _many_keys(draw: Draw, shard: Path, rows: list[dict[str, Any]]) -> str:
    """Rows of all observations that name one range."""
    row = draw.choice(rows)
    for other in rows:
        other |= {name: row[name] for name in ("file", "offset_bytes", "size_bytes", "checksum", "encoding")}
    return "one range for all images"


def _ranges(draw: Draw, shard: Path, rows: list[dict[str, Any]]) -> str:
    """Ranges that overlap, that are empty, or that leave their file."""
    odd = draw.choice(((0, 2**62), (-1, 8), (2**62, 8), (0, 0), (0, -1), (1, 2**31)))
    for row in rows[: 1 + draw.below(len(rows))]:
        row["offset_bytes"], row["size_bytes"] = odd
    return f"ranges of {odd[1]} bytes from {odd[0]}"


def _slow(draw: Draw, shard: Path, rows: list[dict[str, Any]]) -> str:
    """Images of a few kilobytes in many scans of a large camera."""
    path = shard.parents[1] / DESCRIPTOR_FILE
    document = json.loads(path.read_bytes())
    camera = draw.choice(document["cameras"])
    camera |= {"width_px": SLOW_PX, "height_px": SLOW_PX}
    put(path, json.dumps(document).encode())
    num_scans, num_images = 1 + draw.below(26), 1 + draw.below(MAX_SLOW)
    own = [row for row in rows if row["camera"] == camera["name"]]
    content = b""
    for number, row in enumerate(own):
        image = slow_jpeg(SLOW_PX, SLOW_PX, num_scans, number % num_images)
        if number < num_images:
            _name(row, "slow.bin", len(content), image)
            content += image
        else:
            first = own[number % num_images]
            _name(row, "slow.bin", first["offset_bytes"], image)
    put(shard / "slow.bin", content)
    return f"{num_images} images of {SLOW_PX} x {SLOW_PX} pixels in {num_scans} scans"


def _name(row: dict[str, Any], file: str, offset: int, content: bytes) -> None:
    """Let a row of the index name bytes of a file."""
    row |= {
        "file": file, "offset_bytes": offset, "size_bytes": len(content),
        "checksum": hashlib.sha256(content).hexdigest()[:16],
        "encoding": "jpeg" if content.startswith(b"\xff\xd8") else "png",
    }  # fmt: skip


MEDIA_DAMAGES: Mapping[str, Edit] = {
    edit.__name__.strip("_"): edit for edit in (_archive, _image, _many_rows, _many_keys, _ranges, _slow)
}


def damage_media(draw: Draw, root: Path) -> str:
    """Damage the media of a shard, and say how."""
    index = draw.choice(sorted(root.glob("raw/*/frames.parquet")))
    table = decode_table(index.read_bytes(), "frames")
    rows = table.to_pylist()
    what = MEDIA_DAMAGES[draw.choice(tuple(MEDIA_DAMAGES))](draw, index.parent, rows)
    put(index, parquet_bytes(pa.Table.from_pylist(rows, table.schema)))
    return f"{index.parent.relative_to(root)}: {what}"
