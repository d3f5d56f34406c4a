"""Files of images: where images lie, what archives hold beside them, and how much an index names; in plain Python.

Each range of a file is read once, however many rows name it.
"""

import hashlib
import re
from collections import Counter, defaultdict
from dataclasses import dataclass
from typing import Any, NamedTuple

from contract import LIMITS
from layout import Folder, Location, safe, shard_of

MAX_OVERLAP = 2  # images of a file hold at most this many times its bytes
BLOCK, RECORD = 512, 10_240
SUFFIXES = {"jpeg": "jpg", "png": "png"}

COLUMNS = "shard, file, offset_bytes, size_bytes, checksum, encoding, rollout_id, tick, camera"

#: Fields of a header from byte 100 on, in the form of POSIX; names and owners are looked at apart.
_FIELDS = re.compile(
    rb"(?:[0-7]{7}[ \0]){3}(?P<size>[0-7]{11})[ \0][0-7]{11}[ \0](?P<sum>[0-7]{6}[ \0]{2}|[0-7]{7}[ \0])0\0{100}"
    rb"ustar\x0000.{64}(?:[0-7]{7}[ \0]|\0{8}){2}(?P<prefix>.{155})\0{12}",
    re.DOTALL,
)
_TEXT = re.compile(rb"([ -~]*)\0*")


class Row(NamedTuple):
    """A row of the media index."""

    shard: str
    file: str
    offset: int
    size: int
    checksum: str
    encoding: str
    rollout_id: str
    tick: int
    camera: str

    @property
    def path(self) -> str:
        """Its file, relative to the root."""
        return f"{self.shard}/{self.file}"

    @property
    def image(self) -> Location:
        """Where its image is expected."""
        key: Location = {"rollout_id": self.rollout_id, "tick": self.tick, "camera": self.camera}
        return {"file": self.path, "table": "frames", **key}

    @property
    def member(self) -> str:
        """What an archive calls its image."""
        return f"{self.rollout_id}/{self.tick:06}.{self.camera}.{SUFFIXES.get(self.encoding, self.encoding)}"


@dataclass
class Findings:
    """Findings on files of images by rule, and what was looked at."""

    limits: list[Location]
    places: list[Location]
    archives: list[Location]
    num_archives: int = 0


def excess(rows: list[Row], cameras: dict[str, dict[str, Any]]) -> bool:
    """Whether the index of a shard names a range, or pixels, more often than the limits allow."""
    count = Counter((row.file, row.offset, row.size) for row in rows)
    maps = {
        (row.file, row.offset, row.size) for row in rows if cameras.get(row.camera, {}).get("stream") == "semantic_bev"
    }
    seen = {(row.file, row.offset, row.size, row.camera) for row in rows if row.camera in cameras}
    pixels = sum(cameras[camera]["width_px"] * cameras[camera]["height_px"] for *_, camera in seen)
    often = any(number > (1 if place in maps else LIMITS["max_range_rows"]) for place, number in count.items())
    return often or pixels > LIMITS["max_shard_pixels"]


def plain_member(block: bytes) -> tuple[str, int] | None:
    """Name and size of the plain file whose header a block is."""
    fields = _FIELDS.fullmatch(block, 100)
    texts = [_TEXT.fullmatch(block, *span) for span in ((0, 100), (345, 500), (265, 297), (297, 329))]
    if fields is None or None in texts:
        return None
    name, prefix = (text[1].decode() for text in texts[:2] if text is not None)
    if int(fields["sum"].rstrip(b" \0"), 8) != sum(block[:148]) + sum(b" " * 8) + sum(block[156:]):
        return None
    return (f"{prefix}/{name}" if prefix else name), int(fields["size"], 8)


def up(number: int) -> int:
    """A number of bytes filled up to whole blocks."""
    return -(-number // BLOCK) * BLOCK


def walk(path: str, data: bytes, rows: list[Row]) -> list[Location]:
    """What is wrong with an archive whose images rows name."""
    found: list[Location] = []
    by_place: dict[tuple[int, int], list[Row]] = defaultdict(list)
    for row in rows:
        by_place[row.offset, row.size].append(row)
    filled, last, attempts = 0, ("", -1, ""), set()
    for (offset, size), named in sorted(by_place.items()):
        row, start, after = named[0], offset - BLOCK, up(filled)
        if start < after:
            found.append(row.image)
        else:
            found += [{"file": path}] * (any(data[filled:after]) + (start > after))
            found += [row.image] * (plain_member(data[start:offset]) != (row.member, size))
        found += [row.image] * (len(named) > 1)
        key = (row.rollout_id, row.tick, row.camera)
        found += [row.image] * (not (key > last if key[0] == last[0] else key[0] not in attempts))
        attempts.add(row.rollout_id)
        filled, last = max(filled, offset + size), key
    least = up(filled) + 2 * BLOCK
    is_end = least <= len(data) <= -(-least // RECORD) * RECORD and len(data) % BLOCK == 0
    if any(data[filled:]) or not is_end:
        found.append({"file": path})
    return found


def misplaced(data: bytes, rows: list[Row]) -> list[Location]:
    """Images that are not where rows say."""
    ranges = {(row.offset, row.size) for row in rows if row.offset >= 0}
    inside = sum(max(min(size, len(data) - offset), 0) for offset, size in ranges)
    if inside > MAX_OVERLAP * len(data):
        return [{"file": rows[0].path}]
    digests = {}
    for offset, size in ranges:
        if 0 < size <= LIMITS["max_image_bytes"] and offset + size <= len(data):
            digests[offset, size] = hashlib.sha256(data[offset : offset + size]).hexdigest()[:16]
    return [row.image for row in rows if digests.get((row.offset, row.size)) != row.checksum]


def judge(folder: Folder, rows: list[Row], cameras: dict[str, dict[str, Any]], shards: set[str]) -> Findings:
    """Judges the files of images of shards whose index can be read."""
    findings = Findings([], [], [])
    by_file: dict[str, list[Row]] = defaultdict(list)
    for shard in sorted(shards):
        own = [row for row in rows if row.shard == shard and safe(row.path) and "/" not in row.file]
        if excess(own, cameras):
            findings.limits.append({"file": f"{shard}/frames.parquet"})
            continue
        for path in folder.kinds:
            if shard_of(path) == shard and path.endswith(".tar"):
                by_file[path] = []
        for row in own:
            by_file[row.path].append(row)
    for path, named in by_file.items():
        if path not in folder.kinds and path not in folder.manifest.digests:
            findings.places.append({"file": path})
        data = folder.read(path, LIMITS["max_media_bytes"]) if path in folder.sound else None
        if data is None:
            continue
        misfits = misplaced(data, named)
        findings.places += misfits
        if path.endswith(".tar"):
            findings.num_archives += 1
            if misfits != [{"file": path}]:
                findings.archives += walk(path, data, named)
    return findings
