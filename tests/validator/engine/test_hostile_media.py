"""Media files that are damaged, lie, bomb, or are no images at all: each ends in the finding that it asks for."""

from __future__ import annotations

import hashlib
import os
import pickle
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import NOMINAL, SHARD_0, SHARD_1, judged, new_draft
from tests.validator.engine.rules.cases.images import COLOURS
from tests.validator.engine.rules.cases.media import JPEG

from branchdrive.contract.columns import STREAMS
from branchdrive.testing.media import MEDIA_FILE, png

FORM, WHOLE, DECODES = "BD-FRM-005", "BD-FRM-006", "BD-FRM-008"

PNG = png(COLOURS)
HEAD, TAIL = PNG[:8], PNG[-12:]


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + zlib.crc32(kind + body).to_bytes(4, "big")


def _png(data: bytes, *, width: int = 8, height: int = 4, depth: int = 8, colour: int = 2, interlace: int = 0) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, interlace)
    return HEAD + _chunk(b"IHDR", header) + _chunk(b"IDAT", data) + TAIL


def _flipped(content: bytes, place: int) -> bytes:
    return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]


def _jpeg(at: int, value: bytes) -> bytes:
    """The JPEG with other bytes at a place of its frame header, counted from its marker."""
    place = JPEG.index(b"\xff\xc0") + at
    return JPEG[:place] + value + JPEG[place + len(value) :]


ROWS = zlib.compress(b"".join(b"\x00" + row.tobytes() for row in COLOURS))
SCAN = JPEG.index(b"\xff\xda")

DAMAGED: dict[str, tuple[str, str, bytes]] = {
    "text": (FORM, "png", b"a picture of the road ahead"),
    "one byte": (FORM, "png", b"\x89"),
    "html": (FORM, "jpeg", b"<html><img src='front.jpg'></html>"),
    "pickle": (FORM, "png", pickle.dumps(COLOURS.tolist())),
    "archive": (FORM, "png", b"PK\x03\x04" + bytes(60)),
    "gif": (FORM, "png", b"GIF89a" + bytes(40)),
    "bitmap": (FORM, "png", b"BM" + bytes(120)),
    "table": (FORM, "jpeg", b"PAR1" + bytes(40) + b"PAR1"),
    "zeros": (FORM, "png", bytes(len(PNG))),
    "noise": (FORM, "png", np.random.default_rng(1).bytes(300)),
    "png begun": (FORM, "png", HEAD),
    "png cut in its header": (FORM, "png", PNG[:20]),
    "png without a header": (FORM, "png", HEAD + PNG[33:]),
    "png of 16 bits": (FORM, "png", _png(ROWS, depth=16)),
    "png of 1 bit": (FORM, "png", _png(ROWS, depth=1, colour=0)),
    "png with a palette": (FORM, "png", _png(ROWS, colour=3)),
    "png with transparency": (FORM, "png", _png(ROWS, colour=6)),
    "png with a transparent colour": (FORM, "png", PNG[:33] + _chunk(b"tRNS", bytes(6)) + PNG[33:]),
    "grey png": (FORM, "png", png(COLOURS[..., 0])),
    "interlaced png": (FORM, "png", _png(ROWS, interlace=1)),
    "png of no width": (FORM, "png", _png(ROWS, width=0)),
    "png of absurd size": (FORM, "png", _png(ROWS, width=2**31 - 1, height=2**31 - 1)),
    "png of twice the height": (FORM, "png", _png(ROWS, height=8)),
    "png indexed as jpeg": (FORM, "jpeg", PNG),
    "jpeg indexed as png": (FORM, "png", JPEG),
    "jpeg begun": (FORM, "jpeg", JPEG[:4]),
    "jpeg without a frame": (FORM, "jpeg", JPEG[:2] + JPEG[SCAN:]),
    "jpeg of 12 bits": (FORM, "jpeg", _jpeg(4, b"\x0c")),
    "jpeg of absurd size": (FORM, "jpeg", _jpeg(5, b"\xff\xff\xff\xff")),
    "jpeg of four channels": (FORM, "jpeg", _jpeg(9, b"\x04")),
    "jpeg of lossless coding": (FORM, "jpeg", _jpeg(1, b"\xc3")),
    "jpeg of arithmetic coding": (FORM, "jpeg", _jpeg(1, b"\xc9")),
    "jpeg whose segments do not end": (FORM, "jpeg", JPEG[:2] + b"\xff\xe0\x00\x00" * 400),
    "png cut in half": (WHOLE, "png", PNG[: len(PNG) // 2]),
    "png without its end": (WHOLE, "png", PNG[:-12]),
    "png with a flipped bit": (WHOLE, "png", _flipped(PNG, 80)),
    "png with a flipped bit in its header's checksum": (WHOLE, "png", _flipped(PNG, 30)),
    "png with a chunk that is longer than the file": (WHOLE, "png", PNG[:33] + b"\x7f" + PNG[34:]),
    "png with bytes behind it": (WHOLE, "png", PNG + b"more"),
    "jpeg cut in half": (WHOLE, "jpeg", JPEG[: SCAN + 14]),
    "jpeg with bytes behind it": (WHOLE, "jpeg", JPEG + b"more"),
    "png without data": (WHOLE, "png", PNG[:33] + TAIL),
    "png with data that are not packed": (DECODES, "png", _png(b"road" * 20)),
    "png with too few rows": (DECODES, "png", _png(zlib.compress(bytes(50)))),
    "png with a bomb": (DECODES, "png", _png(zlib.compress(bytes(50_000_000), 9))),
    "jpeg without a scan": (WHOLE, "jpeg", JPEG[:SCAN] + JPEG[-2:]),
}  # fmt: skip
"""What is written in place of an image, under which encoding, and the rule that must find it."""


def test_every_damaged_image_ends_in_its_finding(tmp_path: Path) -> None:
    draft = new_draft("media")
    contents: dict[str, bytes] = {SHARD_0: b"", SHARD_1: b""}
    attempts = [*draft.take("rollouts", role=["nominal", "intervention", "nominal_replay"])["rollout_id"].to_pylist()]
    assert len(DAMAGED) >= 40
    expected = {}
    for attempt, (name, (rule, encoding, content)) in zip(attempts, DAMAGED.items(), strict=False):
        folder = draft.folder_of(attempt)
        where = {"rollout_id": attempt, "camera": STREAMS["rgb_surround"].cameras[0]}
        draft.set("frames", "encoding", encoding, **where)
        draft.drop("frames", **where, tick=range(BRANCH_TICK))
        draft.drop("frames", **where, tick=range(BRANCH_TICK + 1, 1000))
        row = {"file": "damaged.bin", "offset_bytes": len(contents[folder]), "size_bytes": len(content)}
        row["checksum"] = hashlib.sha256(content).hexdigest()[:16]
        for column, value in row.items():
            draft.set("frames", column, value, **where)
        contents[folder] += content
        expected[attempt] = (name, rule)
    assert len(expected) == len(DAMAGED)
    for folder, content in contents.items():
        draft.before_seal(lambda root, f=folder, c=content: (root / f / "damaged.bin").write_bytes(c))

    report = judged(draft, tmp_path)

    assert report.errors == ()
    found = {
        (str(finding.location["rollout_id"]), finding.rule)
        for finding in report.findings
        if finding.rule in (FORM, WHOLE, DECODES)
    }
    wanted = {(attempt, rule) for attempt, (_, rule) in expected.items()}
    assert found == wanted, [expected[attempt] for attempt, _ in found ^ wanted]


@pytest.mark.parametrize("kind", ["pipe", "link"])
def test_what_is_no_regular_file_is_not_called_missing_too(kind: str, tmp_path: Path) -> None:
    draft = new_draft("media")

    def replace(root: Path) -> None:
        media = root / SHARD_1 / MEDIA_FILE
        media.unlink()
        os.mkfifo(media) if kind == "pipe" else media.symlink_to("/dev/null")

    draft.after_seal(replace)
    failed = {finding.rule for finding in judged(draft, tmp_path).findings}
    assert "BD-LAY-006" in failed
    assert "BD-FRM-002" not in failed


def test_a_null_in_the_index_is_reported_once(tmp_path: Path) -> None:
    draft = new_draft("media")
    draft.set("frames", "encoding", None, rollout_id=NOMINAL, camera="front", tick=BRANCH_TICK)
    draft.set("frames", "rollout_id", None, rollout_id=NOMINAL, camera="rear", tick=BRANCH_TICK)
    found = {finding.rule: finding.location for finding in judged(draft, tmp_path).findings}
    assert "BD-NUL-001" in found
    assert not {"BD-KEY-004", "BD-FRM-007"} & found.keys()
